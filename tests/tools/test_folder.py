"""The run folder: whole or not there, and never over somebody's files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tools.errors import RunFolderError
from tools.records.folder import FILES, RunFolder, default_path, is_run_folder


def fill(folder: RunFolder, text: str = "x") -> None:
    for name in ("scenario.toml", "summary.json", "truth.csv"):
        folder.write(name, text)


def hidden(parent: Path) -> list[str]:
    return [entry.name for entry in parent.iterdir() if entry.name.startswith(".")]


def test_nothing_is_seen_before_commit_and_all_after(tmp_path: Path) -> None:
    place = tmp_path / "deep" / "run"
    with RunFolder(place) as folder:
        fill(folder)
        assert not place.exists()
        folder.commit()
    assert is_run_folder(place)
    assert hidden(place.parent) == []
    assert place.stat().st_mode & 0o055 == 0o055


def test_a_failed_run_leaves_nothing_and_keeps_the_earlier_one(tmp_path: Path) -> None:
    place = tmp_path / "run"
    with RunFolder(place) as folder:
        fill(folder, "first")
        folder.commit()

    def fail() -> None:
        with RunFolder(place) as second:
            fill(second, "second")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert (place / "summary.json").read_text() == "first"
    assert hidden(tmp_path) == []


def test_a_run_folder_is_replaced(tmp_path: Path) -> None:
    place = tmp_path / "run"
    for text in ("first", "second"):
        with RunFolder(place) as folder:
            fill(folder, text)
            if text == "first":
                folder.write("spi.vcd", "old")
            folder.commit()
    assert (place / "truth.csv").read_text() == "second"
    assert not (place / "spi.vcd").exists()


def test_a_run_folder_with_foreign_files_is_refused(tmp_path: Path) -> None:
    place = tmp_path / "run"
    with RunFolder(place) as folder:
        fill(folder, "first")
        folder.commit()
    (place / "notes.txt").write_text("mine")
    with pytest.raises(RunFolderError, match=r"holds notes\.txt beside a run"):
        RunFolder(place)
    (place / "more").mkdir()
    with pytest.raises(RunFolderError, match=r"holds more and 1 more beside a run"):
        RunFolder(place)
    assert (place / "truth.csv").read_text() == "first"
    assert hidden(tmp_path) == []


def test_an_empty_folder_is_used(tmp_path: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        (tmp_path / "run").mkdir()
        fill(folder)
        folder.commit()
    assert is_run_folder(tmp_path / "run")


def test_places_that_are_no_run_are_refused(tmp_path: Path) -> None:
    (tmp_path / "holiday.jpg").write_text("precious")
    with pytest.raises(RunFolderError, match="holds other files and no run"):
        RunFolder(tmp_path)
    with pytest.raises(RunFolderError, match="is a file"):
        RunFolder(tmp_path / "holiday.jpg")
    with pytest.raises(RunFolderError, match=r"cannot be written: .*holiday\.jpg is a file"):
        RunFolder(tmp_path / "holiday.jpg" / "run")
    assert hidden(tmp_path) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_place_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(RunFolderError, match="Permission denied"):
            RunFolder(tmp_path / "run")
    finally:
        tmp_path.chmod(0o700)


def test_the_default_place_is_a_free_one(tmp_path: Path) -> None:
    first = default_path("circle", 3, tmp_path)
    assert first == tmp_path / "circle-3"
    first.mkdir()
    assert default_path("circle", 3, tmp_path) == tmp_path / "circle-3.2"


def test_the_summary_is_moved_last() -> None:
    assert FILES[-1] == "summary.json"
