"""Duty cycle on emulated boards: what goes when, what arrives, and what it saves."""

from __future__ import annotations

from procboard.network import SendStatus, Sent
from procboard.routing.duty import ERROR_LIMIT_TICKS, EXCHANGE_TICKS, DutyConfig
from radio_802154 import mac
from tests.procboard.routing.emulated import Mote, Shoal, in_a_row
from tests.procboard.routing.test_controller import all_there_once, sample

DUTY = DutyConfig()
TICK_FS = 10**15 // 32_768
NEAR = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (2.0, 0.0)]


def synchronised(shoal: Shoal) -> None:
    """Wait until all follow one root, and those who joined another first have given it up."""

    def one_time() -> bool:
        return len({m.routing.time.root for m in shoal.motes}) == 1 and None not in [
            m.routing.global_ticks() for m in shoal.motes
        ]

    shoal.run(3)
    shoal.run_until(one_time, 300)
    shoal.run(20)


def radio(mote: Mote) -> dict[str, tuple[float, float]]:
    """Seconds and joules of the radio chip by state."""
    return next(c for c in mote.rail.consumers if c.name == "CC2420").table()


def joules(mote: Mote) -> float:
    return sum(energy for _, energy in radio(mote).values())


def phases(shoal: Shoal, since_fs: int) -> list[tuple[int, int]]:
    """Sending port and phase of the base's shared time [ticks] of messages that began since."""
    shoal.trace.flush()
    now_fs, now = shoal.scheduler.now, shoal.base.routing.global_ticks()
    assert now is not None
    found = []
    for _, (start_fs, _, source, _, psdu) in shoal.frames:
        if start_fs >= since_fs and mac.decode(psdu[:-2]).frame_type is mac.FrameType.DATA:
            found.append((source, (now - (now_fs - start_fs) // TICK_FS) % DUTY.period_ticks))
    return found


def test_radios_that_sleep_save_five_sixths_and_lose_nothing():
    shoal = Shoal(in_a_row(3), loss=0.2, drifts=(0.0, -40.0, 30.0), duty=DUTY)
    synchronised(shoal)
    began, before = shoal.scheduler.now, [joules(mote) for mote in shoal.motes]
    sample(shoal, 16, 4.0)  # of 64 s one whole period is listened to
    awake_w = 18.8e-3 * 3.0
    seconds = (shoal.scheduler.now - began) / 1e15
    for mote, energy in zip(shoal.motes, before, strict=True):
        share = (joules(mote) - energy) / (awake_w * seconds)
        assert 0.14 < share < 0.18
    shoal.motes[2].share(b"item")
    shoal.run_until(lambda: shoal.settled() and bool(shoal.base.items()), 200)
    shoal.run(3)
    all_there_once(shoal)
    for _, phase in phases(shoal, began):
        late = DUTY.window_ticks + ERROR_LIMIT_TICKS
        assert phase < late or phase > DUTY.period_ticks - ERROR_LIMIT_TICKS


def test_what_came_up_outside_the_window_does_not_all_go_at_its_beginning():
    shoal = Shoal(NEAR, duty=DUTY)
    synchronised(shoal)
    for mote in shoal.motes:
        mote.share(b"erases ahead")
    shoal.run(8)
    first: list[int] = []
    for turn in range(4):
        shoal.run_until(lambda: not shoal.base.app.services.network.sends, 5, 0.05)
        shoal.run(0.3)
        since = shoal.scheduler.now
        for mote in shoal.motes:
            mote.share(bytes((turn,)))
        shoal.run(2.5)
        begun: dict[int, int] = {}
        for port, phase in phases(shoal, since):
            begun.setdefault(port, phase)
        assert len(begun) >= 4
        first += begun.values()
        assert max(begun.values()) - min(begun.values()) > 300  # 9 ms: twice the longest frame
    spread = (DUTY.window_ticks - EXCHANGE_TICKS) // 2
    assert max(first) > spread // 2
    assert sum(phase < spread // 2 for phase in first) < 0.8 * len(first)


def test_what_an_application_sends_waits_for_the_window_too():
    shoal = Shoal(NEAR[:2], duty=DUTY)
    synchronised(shoal)
    network = shoal.motes[1].app.services.network
    shoal.run_until(lambda: not network.sends, 5, 0.05)
    shoal.run(0.3)
    since = shoal.scheduler.now
    outcomes: list[Sent] = []
    for _ in range(3):
        assert network.send(0, 0x77, b"now", outcomes.append)
    shoal.run(0.3)
    assert outcomes == []
    shoal.run(2.0)
    assert [sent.status for sent in outcomes] == [SendStatus.ACKNOWLEDGED] * 3
    assert all(phase < DUTY.window_ticks for port, phase in phases(shoal, since) if port == 1)


def test_a_board_without_the_time_listens_and_finds_in():
    shoal = Shoal(NEAR[:3], duty=DUTY)
    synchronised(shoal)
    mote = shoal.motes[2]
    mote.reset()
    before = radio(mote)["rx"][0]
    shoal.run(4.0)
    assert radio(mote)["rx"][0] - before > 3.8
    synchronised(shoal)
    before = radio(mote)["rx"][0]
    shoal.run(8.0)
    assert radio(mote)["rx"][0] - before < 8.0 * 0.2 + 2.0  # a period for discovery among them
    mote.record(b"again")
    shoal.run_until(lambda: bool(shoal.base.kept()), 30)


def test_nobody_sleeps_who_was_not_asked_to():
    shoal = Shoal(NEAR[:2])
    synchronised(shoal)
    before = radio(shoal.motes[1])
    shoal.run(4.0)
    after = radio(shoal.motes[1])
    assert after["power_down"] == before["power_down"]
