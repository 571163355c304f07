"""Compiling is told when it begins, once, and only where there is something to compile."""

from __future__ import annotations

import pytest
from numba import njit

from tools.compiling import NOTICE, compiling_shown, noticed


def test_compiling_is_told_once_and_what_is_compiled_already_is_silent() -> None:
    inner = njit(lambda x: x + 1.0)
    outer = njit(lambda x: inner(x) * 2.0)
    told: list[str] = []
    with noticed(lambda: told.append("begun")) as spent_s:
        assert outer(1.0) == 4.0
        assert inner(1.0) == 2.0
    assert told == ["begun"]
    assert spent_s() > 0.0
    with noticed(lambda: told.append("again")) as spent_s:
        assert outer(2.0) == 6.0
    assert told == ["begun"]
    assert spent_s() == 0.0


@pytest.mark.parametrize("wanted", [True, False])
def test_it_is_told_on_stderr_where_that_is_wanted(
    wanted: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    with compiling_shown(wanted):
        njit(lambda x: x - 1.0)(1.0)
    said = capsys.readouterr()
    assert said.out == ""
    assert (NOTICE in said.err) is wanted
