"""Rough links: nothing that was acknowledged is lost, nothing comes twice, in order.

What one end says is compared with what the other end did. Between the boards: what a link was told
is acknowledged, against what the other link handed to its firmware, and that against the samples
that the application noted. By radio: what a mote's network reports as acknowledged, against what
the other mote's application received. Commands: what the base station sent, against what the
navigation board made of it, tick by tick.
"""

from __future__ import annotations

from collections import Counter
from itertools import groupby
from typing import Any

import pytest

from firmware_model.time import FS_PER_MS
from radio_802154 import messages
from radio_802154.messages import CommandReply, CommandStatus, TailBeatCommand
from spi_bus.frame import MAX_WINDOW
from spi_bus.messages import (
    LINK_MESSAGES,
    BoardEvent,
    CommandApplied,
    GpsReport,
    SensorReport,
    TailBeat,
)

INITIAL = (0.0, 0.2617993877991494, 0.9)
SETTINGS = (
    (0.2, 0.2617993877991494, 0.9),
    (-0.2, 0.2617993877991494, 0.9),
    (0.0, 0.35, 0.9),
    (0.0, 0.2617993877991494, 1.2),
    (0.0, 0.2617993877991494, 0.9),
)
"""Bias, amplitude, frequency of the commands of rough-link, in their order."""

READ_WITHIN_FS = 50 * FS_PER_MS
"""What was acknowledged this shortly before the end may still wait in the receiver's FIFO."""
SETTLED_TICKS = 10
"""A setting is in force once bias and amplitude have slewed to it and stay."""


def crowded(loss: float, error_rate: float) -> tuple[str, ...]:
    """The commands of rough-link, two seconds apart, over links of this quality."""
    beats = ", ".join(
        f"{{at_s={2 * number}.0, bias_rad={bias}, amplitude_rad={amplitude}, "
        f"frequency_hz={frequency}}}"
        for number, (bias, amplitude, frequency) in enumerate(SETTINGS, 1)
    )
    return (
        f"radio.loss_probability={loss}",
        f"link.bit_error_rate={error_rate}",
        f"base_station.tail_beats=[{beats}]",
    )


CASES = {
    "as bundled": ((), None, 1),
    "bundled rates, crowded, seed 2": (crowded(0.3, 2e-4), 14.0, 2),
    "bundled rates, crowded, seed 3": (crowded(0.3, 2e-4), 14.0, 3),
    "much worse air, seed 1": (crowded(0.55, 2e-4), 14.0, 1),
    "much worse air, seed 2": (crowded(0.55, 2e-4), 14.0, 2),
    "much worse wires, seed 1": (crowded(0.3, 2e-3), 14.0, 1),
    "much worse wires, seed 2": (crowded(0.3, 2e-3), 14.0, 2),
}


@pytest.fixture(params=CASES)
def run(request: pytest.FixtureRequest, swim: Any) -> Any:
    sets, duration_s, seed = CASES[request.param]
    return swim("rough-link", *sets, duration_s=duration_s, seed=seed)


@pytest.mark.parametrize("sender", ["nav", "proc"])
def test_what_a_link_was_acknowledged_the_other_delivered_once_and_in_order(
    run: Any, sender: str
) -> None:
    robot = run.bench.robot
    boards = {"nav": robot.nav, "proc": robot.proc}
    (from_link,) = boards.pop(sender).links  # nobody reset
    (to_link,) = boards.popitem()[1].links
    source, sink = run.journal(from_link), run.journal(to_link)
    assert len(source.acknowledged) > 10
    assert source.accepted[: len(sink.delivered)] == sink.delivered
    assert sink.delivered[: len(source.acknowledged)] == source.acknowledged
    again = [link.statistics.retransmissions for link in (from_link, to_link)]
    assert max(again) > 0, "nothing was damaged, so nothing was tried"
    assert run.data.metrics["spi_lost"] == 0


def test_what_the_link_delivered_the_application_got(run: Any) -> None:
    (link,) = run.bench.robot.proc.links
    kinds = (SensorReport, GpsReport, BoardEvent, CommandApplied)
    delivered = [
        payload
        for payload in run.journal(link).delivered
        if isinstance(LINK_MESSAGES.decode(payload), kinds)
    ]
    noted = run.values("proc.samples")
    assert noted == delivered[: len(noted)]
    assert len(delivered) - len(noted) <= 1  # the one that is being worked on


@pytest.mark.parametrize(("sender", "receiver"), [("proc", "base"), ("base", "proc")])
def test_what_a_mote_was_acknowledged_the_other_received_once(
    run: Any, sender: str, receiver: str
) -> None:
    end_fs = run.bench.scheduler.now
    sent: Counter[tuple[int, bytes]] = Counter()
    acknowledged: Counter[tuple[int, bytes]] = Counter()
    for time_fs, (_, am_type, payload, outcome) in run.channels[f"{sender}.radio.sent"]:
        sent[am_type, payload] += 1
        if outcome == "acknowledged" and time_fs < end_fs - READ_WITHIN_FS:
            acknowledged[am_type, payload] += 1
    received = Counter(
        (am_type, payload) for _, am_type, payload in run.values(f"{receiver}.radio.received")
    )
    assert acknowledged.total() > 2
    assert acknowledged - received == Counter(), "acknowledged and lost"
    # The last message may have been received, and its sender does not know yet.
    assert (received - sent).total() <= 1, "received more often than sent"


def test_the_air_was_rough(run: Any) -> None:
    """That frames were repeated, so that there was something to lose and to take twice."""
    frames = [frame for frame in run.data.radio_frames if frame.kind != "ack"]
    said = len(run.channels["proc.radio.sent"]) + len(run.channels["base.radio.sent"])
    assert len(frames) > 1.3 * said
    assert sum(frame.outcome == "lost" for frame in frames) > 10


def test_each_command_by_radio_is_applied_once(run: Any) -> None:
    robot = run.bench.robot
    (link,) = robot.nav.links
    delivered = map(LINK_MESSAGES.decode, run.journal(link).delivered)
    beats = [message for message in delivered if isinstance(message, TailBeat)]
    # The processing board refreshes the command in force; a refreshment has its number. So a
    # command that was carried out twice would come with two numbers, or come back after another.
    numbers = [number for number, _ in groupby(beats, key=lambda beat: beat.command_id)]
    assert len(numbers) == len(set(numbers)) == 1 + len(SETTINGS)
    firsts = [next(beat for beat in beats if beat.command_id == number) for number in numbers]
    for beat, setting in zip(firsts, (INITIAL, *SETTINGS), strict=True):
        assert (beat.bias_rad, beat.amplitude_rad, beat.frequency_hz) == pytest.approx(
            setting, abs=1e-4
        )
    # What the tail then did, by the board's own samples.
    samples = [values[:3] for values in run.values("nav.sample")]
    settled = [
        setting
        for setting, ticks in groupby(samples)
        if setting[1] and sum(1 for _ in ticks) >= SETTLED_TICKS
    ]
    settled = [setting for setting, _ in groupby(settled)]
    if settled[0] == pytest.approx(INITIAL, abs=1e-4):  # else rough wires kept it too long
        del settled[0]
    # On very rough wires a command may come so late that the next one follows on its heels.
    assert len(settled) == len(SETTINGS) or run.config.link.bit_error_rate > 1e-3
    wanted = iter(SETTINGS)
    for found in settled:
        assert any(found == pytest.approx(setting, abs=1e-4) for setting in wanted)


def test_each_command_is_answered(run: Any) -> None:
    wanted = range(1, 1 + len(SETTINGS))
    sent = [
        messages.decode(am_type, payload).command_id
        for _, am_type, payload, _ in run.values("base.radio.sent")
        if messages.encode(TailBeatCommand(0, 0.0, 0.0, 0.0, 0.0))[0] == am_type
    ]
    assert sorted(set(sent)) == list(wanted)
    answered = {}
    for _, am_type, payload in run.values("base.radio.received"):
        message = messages.decode(am_type, payload)
        if isinstance(message, CommandReply):
            answered.setdefault(message.command_id, set()).add(message.status)
    assert sorted(answered) == list(wanted)
    # With half of all frames damaged, the navigation board's word that a command was applied may
    # come after the processing board's patience: the base then hears "unreachable".
    drowned = run.config.link.bit_error_rate > 1e-3
    known = {CommandStatus.APPLIED} | ({CommandStatus.UNREACHABLE} if drowned else set())
    for statuses in answered.values():
        assert len(statuses) == 1, "two answers that contradict each other"
        assert statuses <= known
    confirmed = {
        message.command_id
        for message in map(LINK_MESSAGES.decode, run.values("proc.samples"))
        if isinstance(message, CommandApplied)
    }
    assert drowned or len(confirmed) == 1 + len(SETTINGS)


def test_a_command_that_comes_again_is_seen_somewhere(swim: Any) -> None:
    """Among the cases there is a command that the robot's application received more than once."""
    again = 0
    for sets, duration_s, seed in CASES.values():
        run = swim("rough-link", *sets, duration_s=duration_s, seed=seed)
        received = Counter(
            payload
            for _, am_type, payload in run.values("proc.radio.received")
            if am_type == messages.encode(TailBeatCommand(0, 0.0, 0.0, 0.0, 0.0))[0]
        )
        again += sum(count > 1 for count in received.values())
    assert again > 0


def test_the_timeline_of_the_report_knows_its_frames(run: Any) -> None:
    kinds = Counter(frame.kind for frame in run.data.spi_frames)
    assert set(kinds) <= {
        "hello", "ack", "damaged", "SensorReport", "BoardEvent", "CommandApplied", "TailBeat",
        "SetReporting",
    }  # fmt: skip
    outcomes = Counter(frame.outcome for frame in run.data.spi_frames)
    assert outcomes["retransmission"] > 0
    assert outcomes["crc-error"] == run.data.metrics["spi_crc_errors"] > 0
    # A report that stands in the timeline for the first time was delivered or, behind a gap, will
    # be: no more of them than a window holds.
    (link,) = run.bench.robot.proc.links
    delivered = map(LINK_MESSAGES.decode, run.journal(link).delivered)
    reports = sum(isinstance(message, SensorReport) for message in delivered)
    first = sum(f.kind == "SensorReport" and f.outcome == "ok" for f in run.data.spi_frames)
    assert 0 <= first - reports <= MAX_WINDOW
