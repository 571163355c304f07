"""tshark reads radio.pcap: every FCS is right, and acknowledgements belong to their frames.

The record's time stamp is the first symbol of the preamble. So tshark's `ack_time`, from the stamp
of a frame to that of its acknowledgement, is the frame's own time in the air, 32 µs for each of its
octets with the synchronisation header (4 + 1) and the length octet, and then twelve symbols:
192 µs (IEEE 802.15.4-2006, 7.5.6.4.2). tshark knows nothing of either.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytestmark = [
    pytest.mark.oracle,
    pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed"),
]

OCTET_S = 32e-6
BEFORE_THE_PSDU = 6
TURNAROUND_S = 192e-6
RESOLUTION_S = 2e-9  # two stamps in whole nanoseconds

FIELDS = (
    "frame.number",
    "frame.time_relative",
    "wpan.frame_type",
    "wpan.seq_no",
    "wpan.fcs_ok",
    "wpan-tap.data_length",
    "wpan.ack_request",
    "wpan.ack_to",
    "wpan.ack_time",
    "wpan.ack_in",
)
DATA, ACK = 1, 2


class Seen(NamedTuple):
    """A frame as tshark sees it."""

    number: int
    time_s: float
    kind: int
    sequence: int
    fcs_ok: bool
    octets: int
    wants_ack: bool
    ack_to: int | None
    ack_time_s: float | None
    ack_in: int | None


def read(pcap: Path) -> list[Seen]:
    options = [option for name in FIELDS for option in ("-e", name)]
    tracking = ("-o", "wpan.802154_ack_tracking:TRUE")
    done = subprocess.run(
        # Two passes, so that a frame knows of the acknowledgement that comes after it.
        ["tshark", "-2", *tracking, "-r", str(pcap), "-T", "fields", *options],
        capture_output=True,
        text=True,
        check=True,
    )
    seen = []
    for line in done.stdout.splitlines():
        number, time, kind, sequence, fcs, octets, wants, ack_to, ack_time, ack_in = line.split(
            "\t"
        )
        seen.append(
            Seen(
                int(number),
                float(time),
                int(kind, 0),
                int(sequence, 0),
                fcs == "1",
                int(octets),
                wants == "1",
                int(ack_to) if ack_to else None,
                float(ack_time) if ack_time else None,
                int(ack_in) if ack_in else None,
            )
        )
    return seen


LOSSY = (
    "radio.loss_probability=0.3",
    "base_station.tail_beats=[{at_s=1.0, bias_rad=0.2}, {at_s=2.0, bias_rad=-0.2}]",
    "base_station.send_pose=true",
    "base_station.pose_period_s=0.25",
)


@pytest.fixture(params=[(), LOSSY], ids=["clean", "lossy"])
def run(request: pytest.FixtureRequest, swim: Any) -> Any:
    return swim("swim-forward", *request.param, duration_s=4.0, keep=True)


def test_every_fcs_is_right(run: Any) -> None:
    seen = read(run.folder / "radio.pcap")
    assert len(seen) == len(run.channels["radio"]) > 10
    assert [frame.number for frame in seen if not frame.fcs_ok] == []


def test_a_wrong_bit_in_a_frame_is_noticed(run: Any, tmp_path: Path) -> None:
    """That tshark checks the FCS of this kind of file at all."""
    octets = bytearray((run.folder / "radio.pcap").read_bytes())
    octets[-1] ^= 0x01  # in the FCS of the last frame
    spoilt = tmp_path / "spoilt.pcap"
    spoilt.write_bytes(octets)
    assert [frame.fcs_ok for frame in read(spoilt)].count(False) == 1


def test_acknowledgements_belong_to_their_frames_at_the_right_time(run: Any) -> None:
    seen = {frame.number: frame for frame in read(run.folder / "radio.pcap")}
    acks = [frame for frame in seen.values() if frame.kind == ACK]
    assert len(acks) > 5
    for ack in acks:
        assert ack.ack_to is not None
        asked = seen[ack.ack_to]
        assert (asked.sequence, asked.wants_ack) == (ack.sequence, True)
        expected = (BEFORE_THE_PSDU + asked.octets) * OCTET_S + TURNAROUND_S
        assert ack.ack_time_s == pytest.approx(expected, abs=RESOLUTION_S)
        assert asked.ack_in == ack.number
    assert len({ack.ack_to for ack in acks}) == len(acks)


def test_what_was_acknowledged_is_what_the_motes_say(run: Any) -> None:
    """A message that its sender reports as acknowledged has a frame with an acknowledgement."""
    seen = read(run.folder / "radio.pcap")
    answered = sum(frame.ack_in is not None for frame in seen)
    reported = [
        outcome
        for name in ("proc", "base")
        for _, _, _, outcome in run.values(f"{name}.radio.sent")
    ]
    acknowledged = reported.count("acknowledged")
    if run.config.radio.loss_probability:
        unanswered = [frame for frame in seen if frame.wants_ack and frame.ack_in is None]
        assert unanswered, "nothing was lost, so nothing was tried"
        # An acknowledgement may be lost itself, and the frame comes again.
        assert answered >= acknowledged > 5
    else:
        assert answered == acknowledged == len(reported)


def test_time_stamps_are_those_of_the_trace(run: Any) -> None:
    begins = sorted(value[0] for _, value in run.channels["radio"])
    seen = read(run.folder / "radio.pcap")
    expected = [(begin_fs - begins[0]) / 1e15 for begin_fs in begins]
    assert [frame.time_s for frame in seen] == pytest.approx(expected, abs=RESOLUTION_S)
