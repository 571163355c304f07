"""The fuzz targets: seeds and mutations of them always, atheris where it is there."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from random import Random

import pytest

from tools.fuzz.__main__ import main
from tools.fuzz.targets import TARGETS, Target

each = pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)


@each
def test_seeds_and_what_is_near_them(target: Target) -> None:
    random = Random(1)
    target.run(b"")
    for seed in target.seeds:
        target.run(seed)
        for _ in range(40):
            damaged = bytearray(seed)
            for _ in range(random.randrange(1, 4)):
                place = random.randrange(len(damaged) + 1)
                damaged[place : place + random.randrange(3)] = random.randbytes(random.randrange(3))
            target.run(bytes(damaged))


def test_a_target_can_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    from spi_bus import cobs

    monkeypatch.setattr(cobs, "encode", lambda data: data)
    target = next(target for target in TARGETS if target.name == "cobs")
    with pytest.raises(AssertionError):
        target.run(b"\0\0")


@pytest.mark.skipif(importlib.util.find_spec("atheris") is None, reason="atheris is not installed")
def test_a_short_run_under_atheris(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    artifacts = ["--artifacts", str(tmp_path / "findings")]
    assert main(["all", "--runs", "200", *artifacts]) == 0
    lines = capsys.readouterr().out.splitlines()[1:]
    assert len(lines) == len(TARGETS)
    assert all(line.endswith("none") and int(line.split()[1]) >= 200 for line in lines)


def test_without_atheris_one_line_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main(["cobs", "--runs", "1"]) == 2
    said = capsys.readouterr().err
    assert "pip install" in said
    assert said.count("\n") == 1


def test_an_input_is_run_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "input"
    path.write_bytes(b"\x01\x02")
    assert main(["cobs", "--input", str(path)]) == 0
    assert main(["cobs", "--input", str(tmp_path / "none")]) == 2
