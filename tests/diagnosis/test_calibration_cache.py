"""Kept calibrations: under a key that holds all they depend on, and drawn anew where damaged."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.test_engine import OPTIONS, diagnosed
from tools.diagnosis import calibration

SPOILT: dict[str, Callable[[bytes], bytes]] = {
    "no archive": lambda whole: b"not an archive",
    "empty": lambda whole: b"",
    "torn off": lambda whole: whole[: len(whole) // 2],
    "a byte changed": lambda whole: whole[:300] + bytes([whole[300] ^ 1]) + whole[301:],
    "another archive": lambda whole: _archive(),
}


def _archive() -> bytes:
    file = io.BytesIO()
    np.savez(file, something=np.ones(3))
    return file.getvalue()


@pytest.mark.parametrize("case", SPOILT)
def test_a_spoilt_cache_is_drawn_anew_and_said(case: str, tmp_path: Path) -> None:
    first = diagnosed(18, replace(OPTIONS, cache=tmp_path))
    (kept,) = tmp_path.iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(SPOILT[case](whole))
    second = diagnosed(18, replace(OPTIONS, cache=tmp_path))
    assert not second.calibration.cached
    assert str(kept) in second.calibration.note
    assert not first.calibration.note
    assert second.report == first.report
    with np.load(kept) as again, np.load(io.BytesIO(whole)) as before:
        np.testing.assert_array_equal(again["gains"], before["gains"])


def test_the_key_of_a_calibration_holds_all_that_it_depends_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever of its arguments is another is another calibration."""
    asked: list[tuple[Any, ...]] = []
    kept = calibration.digest

    def keeping(*given: Any) -> str:
        asked.append(given)
        return kept(*given)

    monkeypatch.setattr(calibration, "digest", keeping)
    diagnosed(18, replace(OPTIONS, cache=tmp_path))
    problem, point, given, screen, noise, count, seed = asked[0]
    first = kept(*asked[0])
    assert kept(problem, point, given, screen, noise, count, seed) == first
    longer = [rows[::2] for rows in screen.first_rows]
    run = problem.runs[0]
    others: dict[str, tuple[Any, ...]] = {
        "blocks": (problem, point, given, replace(screen, first_rows=tuple(longer)), noise),
        "groups": (problem, point, given, replace(screen, groups=screen.groups[:1]), noise),
        "point": (
            problem,
            replace(point, shared={**point.shared, "a": 1e-9}),
            given,
            screen,
            noise,
        ),
        "priors": (
            problem,
            point,
            replace(given, shared=tuple(replace(p, prior_sd=1.0) for p in given.shared)),
            screen,
            noise,
        ),
        "values": (
            replace(problem, runs=(replace(run, value=run.value + 1e-9), *problem.runs[1:])),
            point,
            given,
            screen,
            noise,
        ),
        "free noise": (problem, point, given, screen, replace(noise, free=noise.free[:-1])),
    }
    keys = {name: kept(*arguments, count, seed) for name, arguments in others.items()}
    keys |= {"count": kept(*asked[0][:5], count + 1, seed), "seed": kept(*asked[0][:6], seed + 1)}
    assert len({first, *keys.values()}) == len(keys) + 1
