"""tshark reads the radio of a survey by several robots: FCS, acknowledgements, sequence numbers.

A sender counts its data sequence number up by one a frame (IEEE 802.15.4-2006, 7.2.1.2), and
sends a frame again under the same number only where it asked for an acknowledgement and heard none
(7.5.6.4.3). tshark pairs acknowledgements with frames by itself.
"""

from __future__ import annotations

import itertools
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import pytest

from tools.cli import main

pytestmark = [
    pytest.mark.oracle,
    pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed"),
]

FIELDS = ("frame_type", "seq_no", "fcs_ok", "ack_request", "ack_to", "ack_in", "src16")
DATA, ACK = 1, 2
DURATION_S = "70"


class Seen(NamedTuple):
    """A frame as tshark sees it: numbers of frames begin with 1."""

    kind: int
    sequence: int
    fcs_ok: bool
    wants_ack: bool
    ack_to: str
    ack_in: str
    source: str


def read(pcap: Path) -> list[Seen]:
    options = [option for name in FIELDS for option in ("-e", f"wpan.{name}")]
    tracking = ("-2", "-o", "wpan.802154_ack_tracking:TRUE")
    done = subprocess.run(
        ["tshark", *tracking, "-r", str(pcap), "-T", "fields", *options],
        capture_output=True,
        text=True,
        check=True,
    )
    seen = []
    for line in done.stdout.splitlines():
        kind, sequence, fcs, wants, ack_to, ack_in, source = line.split("\t")
        number = int(sequence, 0)
        seen.append(Seen(int(kind, 0), number, fcs == "1", wants == "1", ack_to, ack_in, source))
    return seen


@pytest.fixture(scope="module", params=["0.0", "0.3"], ids=["clean", "lossy"])
def air(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Seen]:
    """The frames of two robots and a base in the first part of a mission."""
    place = tmp_path_factory.mktemp("survey") / "run"
    told = ["--duration", DURATION_S, "--quiet", "--out", str(place)]
    loss = f"radio.loss_probability={request.param}"
    assert main(["run", "survey-tank", "--set", loss, *told]) == 0
    return read(place / "radio.pcap")


def lossy(request: pytest.FixtureRequest) -> bool:
    return "lossy" in request.node.name


def test_every_fcs_is_right(air: list[Seen]) -> None:
    assert len(air) > 200
    assert all(frame.fcs_ok for frame in air)
    assert {frame.kind for frame in air} == {DATA, ACK}


def test_every_acknowledgement_has_its_frame(
    air: list[Seen], request: pytest.FixtureRequest
) -> None:
    acks = [frame for frame in air if frame.kind == ACK]
    assert len(acks) > 30
    for ack in acks:
        asked = air[int(ack.ack_to) - 1]
        assert asked.wants_ack
        assert asked.sequence == ack.sequence
    assert len({ack.ack_to for ack in acks}) == len(acks)
    unanswered = [frame for frame in air if frame.wants_ack and not frame.ack_in]
    assert bool(unanswered) == lossy(request)


def test_sequence_numbers_count_up_and_stay_only_for_a_frame_sent_again(
    air: list[Seen], request: pytest.FixtureRequest
) -> None:
    by_source = defaultdict(list)
    for frame in air:
        if frame.kind == DATA:
            by_source[frame.source].append(frame)
    assert len(by_source) == 3
    repeats = 0
    for frames in by_source.values():
        for before, after in itertools.pairwise(frames):
            step = (after.sequence - before.sequence) % 256
            assert step == 1 or (step == 0 and before.wants_ack and after.wants_ack)
            repeats += step == 0
    assert bool(repeats) == lossy(request)
