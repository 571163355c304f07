"""SPI controller at the level of bytes and words: double buffer, data-ready, lateness, power."""

from __future__ import annotations

from spi_bus.link import Link, LinkUp, Role

BYTE_FS = 31 * 10**9


def clock(r, mosi=0):
    """One byte both ways, with the next one right behind it; chip select is the caller's."""
    miso = r.board.spi.begin()
    r.scheduler.run(r.scheduler.now + BYTE_FS)
    r.board.spi.end(mosi)
    return miso


def settle(r):
    r.scheduler.run(r.scheduler.now + 10**12)


def test_data_ready_falls_when_the_last_byte_has_left_the_chip(robot):
    r = robot(master=False)
    r.run(0.3)
    assert r.board.data_ready.value  # a HELLO waits
    received = bytearray()
    r.board.spi.select(True)
    while r.board.data_ready.value:
        received += bytes((clock(r), clock(r)))
        assert len(received) < 100
        if received[-1] == 0 and any(received):
            settle(r)
    assert received[:4] == bytes(4)  # two words of filler were loaded before anything waited
    assert received[4] != 0
    assert received[-1] == 0  # the delimiter was in the last word …
    assert received[-3] != 0  # … and nothing was clocked after it
    events = Link(Role.MASTER, 1).receive(bytes(received), 0)
    assert events == []  # intact HELLOs that wait for an answer: no error


def test_handshake_over_single_bytes(robot):
    r = robot(master=False)
    r.run(0.3)
    master = Link(Role.MASTER, 9)
    r.board.spi.select(True)
    events = []
    for _ in range(6):
        out = master.data_to_send(r.scheduler.now // 10**9).ljust(40, b"\0")
        events += master.receive(bytes(clock(r, b) for b in out), r.scheduler.now // 10**9)
        r.scheduler.run(r.scheduler.now + 20 * 10**12)
        master.handle_timer(r.scheduler.now // 10**9)
    assert [e for e in events if isinstance(e, LinkUp)] == [LinkUp(1)]
    assert r.board.firmware.link.link.peer_epoch == 9
    assert r.board.mcu.spi1.underruns == 0


def test_bytes_back_to_back_are_never_missed_at_262_khz(robot):
    """The handler ends well within a byte even in the middle of a control tick."""
    r = robot(master=False)
    r.run(0.5)
    r.board.spi.select(True)
    for k in range(3000):  # 93 ms: several ticks, scans and I²C transfers
        clock(r, k & 0xFF)
    assert r.board.mcu.spi1.overruns == 0
    assert r.board.mcu.spi1.underruns == 0


def test_a_clock_faster_than_the_handler_overruns_and_is_reported(robot):
    r = robot(master=False)
    r.run(0.5)
    spi = r.board.spi
    spi.select(True)
    for _ in range(100):
        spi.begin()
        r.scheduler.run(r.scheduler.now + 2 * 10**9)  # 4 MHz: 30 cycles a byte
        spi.end(0x55)
    r.run(1.0)
    assert r.board.mcu.spi1.overruns > 0
    assert r.board.firmware.link.overruns > 0


def test_a_board_without_power_answers_filler(robot):
    r = robot(master=False)
    r.run(0.3)
    r.rail.set_volts(0.0)
    settle(r)
    r.board.spi.select(True)
    assert [clock(r, 0x55) for _ in range(10)] == [0] * 10
    assert not r.board.data_ready.value


def test_a_frame_whose_end_comes_after_the_task_has_run_is_whole(robot):
    """The task may take what has come in the middle of a frame; a zero word then ends it."""
    r = robot(master=False)
    r.run(0.3)
    link = r.board.firmware.link
    r.board.spi.select(True)
    hello = Link(Role.MASTER, 9).data_to_send(0)
    body = hello.removesuffix(b"\0")
    if len(body) % 2:  # to whole words: the delimiter is in a word of its own
        body = b"\0" + body
    before = link.link.statistics.frames_received
    for _ in range(3):
        for byte in body:
            clock(r, byte)
        link.work.set()
        settle(r)
        assert not link._incoming  # taken, without its end
        clock(r)
        clock(r)  # the end
        settle(r)
    assert link.link.statistics.crc_errors == 0
    assert link.link.statistics.framing_errors == 0
    assert link.link.statistics.frames_received == before + 3
