"""`fishbed decode` as a user meets it."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import pytest

from spi_bus.frame import Frame, FrameType
from spi_bus.messages import LINK_MESSAGES, Ping
from tools.cli import main

MOTE = "7e 44 26 00 ff ff 00 00 04 22 06 7d 5e 7d 5d 01 02 18 7b 7e\n"


@pytest.fixture
def mote(tmp_path: Path) -> Path:
    path = tmp_path / "mote.hex"
    path.write_text(MOTE)
    return path


def test_the_mote_s_packet_in_words(mote: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", str(mote)]) == 0
    out = capsys.readouterr().out
    assert "plain hex, tinyos" in out
    assert "AM 0x06" in out
    assert "0x0000 to 0xffff number 38" in out
    assert "data=7e 7d 01 02" in out


def test_json_is_one_document(mote: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", "--json", str(mote), str(mote)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [file["protocol"] for file in document["files"]] == ["tinyos", "tinyos"]
    (item,) = document["files"][1]["items"]
    assert item["fields"] == {"data": "7e 7d 01 02"}
    assert item["header"] == {"sequence": 38, "group": 34}
    assert document["files"][0]["summary"]["messages"] == {"AM 0x06": 1}


def test_wrong_files_are_one_line_and_leave_stdout_empty(
    mote: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty"
    empty.touch()
    for wrong, words in (
        (str(empty), "is empty"),
        (str(tmp_path / "none"), "cannot be read"),
        (str(tmp_path), "without spi.vcd"),
    ):
        assert main(["decode", str(mote), wrong]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert words in said.err
        assert said.err.count("\n") == 1


def test_a_file_s_words_do_not_move_the_cursor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.log"
    path.write_bytes(b"fishbed-transport-log 1\n0.000000 ! down: \x1b[2J\n" + b"0.1 \x1b[2J\n")
    assert main(["decode", "--protocol", "link", str(path)]) == 1
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err


def test_a_large_file_is_streamed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "large.bin"
    payload = LINK_MESSAGES.encode(Ping(7))
    frames = [Frame(FrameType.DATA, 0x11, n, 0, 0, 4, payload).encode() for n in range(256)]
    path.write_bytes(b"".join(frames) * 16)
    main(["decode", "--summary", str(path)])  # imports, tables
    tracemalloc.start()
    assert main(["decode", "--summary", str(path)]) == 0
    small = tracemalloc.get_traced_memory()[1]
    path.write_bytes(b"".join(frames) * 64)
    tracemalloc.reset_peak()
    assert main(["decode", "--summary", str(path)]) == 0
    large = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert large < small + 100_000
    assert "16384 (Ping 16384)" in capsys.readouterr().out
