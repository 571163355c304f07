"""A run's own files: what is decoded from its wires and its air is what its summary counts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tools.cli import main


def test_a_rough_run_is_counted_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    arguments = ["run", "rough-link", "--duration", "5", "--seed", "2", "--out", str(folder)]
    assert main([*arguments, "--quiet"]) == 0
    metrics = json.loads((folder / "summary.json").read_text())["metrics"]
    capsys.readouterr()
    assert main(["decode", "--json", str(folder)]) == 0
    wires, air = (file["summary"] for file in json.loads(capsys.readouterr().out)["files"])
    assert wires["frames"] == metrics["spi_frames"] > 100
    assert wires["crc_errors"] == metrics["spi_crc_errors"] > 0
    assert air["messages_total"] == metrics["radio_sent"] > 5
    assert air["retransmissions"] > 0
