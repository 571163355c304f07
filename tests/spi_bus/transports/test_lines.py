"""Particulars of single transports that the kit, which is the same for all, does not ask."""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path

import can
import pytest

from spi_bus.errors import TransportLost
from spi_bus.link import Link, Role
from spi_bus.messages import Ping
from spi_bus.transports import BackOff, OpenContext, OutageLog, open_transport
from spi_bus.transports.can_bus import CanTransport
from spi_bus.transports.isotp import IsoTpConfig
from spi_bus.transports.pair import open_pair
from spi_bus.transports.runner import LinkRunner, run_all


def test_a_line_that_broke_while_writing_is_read_to_its_end_first() -> None:
    one, other = open_pair()
    other.write(b"last words")
    other.close()
    one.write(b"too late")  # nobody is told yet: there is something to read
    assert one.room == 0
    assert one.pending == 0
    with pytest.raises(TransportLost, match="gone"):
        one.write(b"x")
    assert one.read() == b"last words"
    with pytest.raises(TransportLost, match="gone"):
        one.read()
    one.close()


def test_others_on_the_bus_are_not_heard() -> None:
    base = "can://virtual/others"
    one = open_transport(f"{base}?tx=0x101&rx=0x201")
    other = open_transport(f"{base}?tx=0x201&rx=0x101")
    stranger = can.Bus("others", interface="virtual")
    for arbitration_id, extended, remote in (
        (0x200, False, False),
        (0x101, True, False),
        (0x101, False, True),
    ):
        stranger.send(
            can.Message(
                arbitration_id=arbitration_id,
                is_extended_id=extended,
                is_remote_frame=remote,
                data=None if remote else b"\x03bad",
                dlc=4,
            )
        )
    one.write(b"good")
    assert other.read() == b"good"
    assert other.failures == {}
    stranger.shutdown()
    one.close()
    other.close()


class FullBus:
    """An adapter whose queue is full for a while, and which then breaks."""

    def __init__(self) -> None:
        self.full = True
        self.broken = False
        self.sent: list[bytes] = []

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        assert timeout == 0
        if self.broken:
            raise can.CanOperationError("Network is down", 100)
        if self.full:
            raise can.CanOperationError("Transmit buffer full", 105)
        self.sent.append(bytes(message.data))

    def recv(self, timeout: float) -> None:
        del timeout

    def shutdown(self) -> None: ...


def test_a_full_adapter_is_tried_again_and_a_broken_one_is_lost() -> None:
    now = [5.0]
    bus = FullBus()
    transport = CanTransport(bus, 0x101, 0x201, IsoTpConfig(), lambda: now[0], "can")
    transport.write(b"hello")
    assert bus.sent == []
    assert transport.pending
    assert transport.next_deadline_s() == pytest.approx(5.001)
    bus.full = False
    transport.flush()
    assert bus.sent == [b"\x05hello\xcc\xcc"]
    assert not transport.pending
    assert transport.next_deadline_s() is None
    bus.broken = True
    transport.write(b"more")
    assert transport.room == 0
    with pytest.raises(TransportLost, match="Network is down"):
        transport.read()


def test_a_payload_that_nobody_takes_is_given_up_and_counted() -> None:
    now = [5.0]
    bus = FullBus()
    bus.full = False
    transport = CanTransport(bus, 0x101, 0x201, IsoTpConfig(), lambda: now[0], "can")
    transport.write(bytes(300))
    assert len(bus.sent) == 1
    assert transport.pending == 300 - 256
    assert transport.next_deadline_s() == pytest.approx(6.0)
    now[0] = 6.0
    assert transport.read() == b""
    assert transport.failures == {"N_TIMEOUT_Bs": 1}
    assert len(bus.sent) == 2, "the next payload begins"


def test_fd_frames_are_long_and_say_so() -> None:
    context = OpenContext()
    watcher = can.Bus("fd", interface="virtual", protocol=can.CanProtocol.CAN_FD)
    end = open_transport("can://virtual/fd?tx=0x101&rx=0x201&fd=1&brs=1", context)
    end.write(bytes(range(40)))
    message = watcher.recv(5.0)
    assert message is not None
    assert (message.is_fd, message.bitrate_switch, len(message.data)) == (True, True, 48)
    assert bytes(message.data[:3]) == b"\x00\x28\x00"
    watcher.shutdown()
    end.close()


@pytest.mark.oracle
def test_another_programs_pty_pair_and_its_end_and_return(tmp_path: Path) -> None:
    """socat's cable between two serial ports: the link comes up, loses it, and has it again."""
    socat = shutil.which("socat")
    if socat is None:
        pytest.skip("socat is not installed")
    paths = tmp_path / "one", tmp_path / "other"

    def plug() -> subprocess.Popen[bytes]:
        program = subprocess.Popen([socat, *(f"pty,raw,echo=0,link={path}" for path in paths)])
        end_s = time.monotonic() + 20.0
        while not all(path.exists() for path in paths):
            assert time.monotonic() < end_s, "socat made no ptys"
            time.sleep(0.01)
        return program

    def unplug(program: subprocess.Popen[bytes]) -> None:
        program.terminate()
        program.wait()

    cable = plug()
    log = OutageLog()
    context = OpenContext(reconnect=BackOff(first_s=0.01, longest_s=0.1), notify=log.note)
    ends = [open_transport(f"serial://{path}", context) for path in paths]
    links = Link(Role.MASTER, 3), Link(Role.SLAVE, 4)
    runners = [LinkRunner(link, end) for link, end in zip(links, ends, strict=True)]

    def arrived(count: int) -> bool:
        return links[1].statistics.messages_received == count and not links[0].queued

    try:
        links[0].send(Ping(1))
        run_all(runners, time.monotonic() + 20.0, lambda: arrived(1))
        unplug(cable)
        links[0].send(Ping(2))
        run_all(runners, time.monotonic() + 20.0, lambda: log.outages == 2)
        assert log.outages == 2
        cable = plug()
        run_all(runners, time.monotonic() + 20.0, lambda: arrived(2))
        assert arrived(2)
        assert log.summary()["attempts"] >= 2
        assert links[1].statistics.peer_resets == 0
    finally:
        unplug(cable)
        for end in ends:
            end.close()
