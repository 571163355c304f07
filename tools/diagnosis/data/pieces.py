"""One recording as several runs: cut where nothing was recorded for long, or to hold some out.

A piece that begins later starts anywhere, with the phase that the beat has there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plant.tail_input import TailProgramme
from tools.diagnosis.data.notice import Notice
from tools.diagnosis.data.screen import LEAST_S, LEAST_SAMPLES, SILENCE_S
from tools.diagnosis.fish.inputs import FishInputs
from tools.diagnosis.model import Run

PIECES = 4
"""A single run is cut into so many, as long as each of them is long enough."""
_LEAST_PIECE_S = 3.0 * LEAST_S
BEFORE_S = 2.0
"""Commands are kept that are so much older than a piece, a bias's memory (`bias_memory_s`): at its
beginning the servo is still on its way to them."""


def at_silences(run: Run, notices: list[Notice]) -> list[Run]:
    """Cut a run where no channel says anything for long: no model knows where a robot is then."""
    silent = np.flatnonzero(np.diff(run.time_s) > SILENCE_S)
    if silent.size == 0:
        return [run]
    longest = float(np.max(np.diff(run.time_s)))
    begins = [0.0, *run.time_s[silent + 1].tolist()]
    ends = [*run.time_s[silent].tolist(), float(run.time_s[-1])]
    made: list[Run] = []
    left_out: list[Run] = []
    for begin_s, end_s in zip(begins, ends, strict=True):
        piece = between(run, begin_s, end_s)
        enough = end_s - begin_s >= LEAST_S and piece.time_s.size >= LEAST_SAMPLES
        (made if enough else left_out).append(piece)
    text = (
        f"{run.name}: nothing at all for {longest:.3g} s; cut there into "
        f"{len(begins)} runs, of which the later start anywhere"
    )
    if left_out:
        text += f"; {', '.join(piece.name for piece in left_out)} too short, and left out"
    notices.append(Notice("silence", text))
    return made


def pieces(run: Run, notices: list[Notice]) -> list[Run]:
    """Cut a single run into several, so that some can be held out; later ones start anywhere."""
    duration_s = float(run.time_s[-1])
    count = min(PIECES, int(duration_s // _LEAST_PIECE_S))
    if count < 2:
        notices.append(
            Notice(
                "single run",
                f"{run.name}: a single short run: nothing is left to test an explanation on; "
                "record several runs with varied manoeuvres",
            )
        )
        return [run]
    edges = [k * duration_s / count for k in range(count + 1)]
    made = []
    for k in range(count):
        piece = between(run, edges[k], edges[k + 1], closed=k == count - 1)
        if piece.time_s.size >= LEAST_SAMPLES:
            made.append(piece)
    notices.append(
        Notice(
            "single run",
            f"{run.name}: a single run was cut into {len(made)} pieces, so that some of it can be "
            "held out; several runs with varied manoeuvres say more",
        )
    )
    return made


def between(run: Run, begin_s: float, end_s: float, *, closed: bool = True) -> Run:
    """Return a part of a run, up to its end or, not ``closed``, to just before it."""
    assert isinstance(run.inputs, FishInputs)
    inside = (run.time_s >= begin_s) & ((run.time_s <= end_s) if closed else (run.time_s < end_s))
    return replace(
        run,
        name=f"{run.name} {begin_s:.0f}–{end_s:.0f} s",
        time_s=run.time_s[inside] - begin_s,
        channel=run.channel[inside],
        value=run.value[inside],
        inputs=later(run.inputs, begin_s),
        at_rest=run.at_rest and begin_s == 0.0,
    )


def later(inputs: FishInputs, begin_s: float) -> FishInputs:
    """Return the inputs from a time on, with the phase that the beat has there."""
    programme = inputs.programme
    phase = programme.phase_rad
    beats, starts = [], []
    ends = (*programme.starts_s[1:], float("inf"))
    for beat, start, end in zip(programme.beats, programme.starts_s, ends, strict=True):
        if end <= begin_s:
            phase += 2.0 * np.pi * beat.frequency_hz * (end - start)
            continue
        if start < begin_s:
            phase += 2.0 * np.pi * beat.frequency_hz * (begin_s - start)
        beats.append(beat)
        starts.append(max(0.0, start - begin_s))
    told_s, told_rad = inputs.told_s, inputs.told_rad
    if told_s is not None and told_rad is not None:
        first = max(0, int(np.searchsorted(told_s, begin_s - BEFORE_S, side="right")) - 1)
        told_s, told_rad = told_s[first:] - begin_s, told_rad[first:]
    return FishInputs(
        TailProgramme(tuple(beats), tuple(starts), phase), told_s, told_rad, inputs.supply_v
    )
