"""The timed command is the real one, and what it says when it fails is kept."""

from pathlib import Path

import pytest

from tools.practice.timing import busy_s, timed


def test_a_command_that_fails_tells_why(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"exit code 2: .*holds no experiment\.toml"):
        timed(tmp_path)


def test_the_time_that_processors_were_busy(tmp_path: Path) -> None:
    import os

    # proc(5): idle and iowait are no work
    (tmp_path / "stat").write_text("cpu  10 20 30 4000 500 6 7 8 0 0\ncpu0 1 1 1 1\n")
    assert busy_s(tmp_path / "stat") == pytest.approx(81.0 / os.sysconf("SC_CLK_TCK"))
    assert busy_s(tmp_path / "none") is None
