"""The fuzz targets: seeds and mutations of them always, atheris where it is there."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from random import Random

import pytest

from tools.fuzz import log
from tools.fuzz.__main__ import main
from tools.fuzz.forms import one_of, parser, stream
from tools.fuzz.piece import PIECE_RUNS, Piece
from tools.fuzz.targets import FILE, TARGETS, Target

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


class Forgetful:
    """A stream decoder with a fault: what a cut parts is lost."""

    buffered = 0

    def receive(self, data: bytes) -> list[bytes]:
        return [part for part in data.split(b"\n")[:-1] if part]


class Hoarder(Forgetful):
    def __init__(self) -> None:
        self.kept = b""

    @property
    def buffered(self) -> int:
        return len(self.kept)

    def receive(self, data: bytes) -> list[bytes]:
        *found, self.kept = (self.kept + data).split(b"\n")
        return [part for part in found if part]


def test_the_forms_see_what_they_are_for() -> None:
    with pytest.raises(AssertionError):
        stream(Forgetful, 9)(b"\x02bcde\n")
    stream(Hoarder, 9)(b"\x02bcde\n")
    with pytest.raises(AssertionError):
        stream(Hoarder, 9)(b"\x02bcde\n0123456789")
    with pytest.raises(AssertionError):
        stream(Hoarder, 9, write=lambda item: item)(b"\x02bcde\n")
    with pytest.raises(AssertionError):
        stream(Hoarder, 9, in_step=(b"x\n", b"x"))(b"\x02bc")
    stream(Hoarder, 9, write=lambda item: item + b"\n", in_step=(b"\nx\n", b"x"))(b"\x02bc")
    parser(int, ValueError, lambda value: b"%d" % value)(b" 07")
    parser(int, ValueError)(b"seven")
    with pytest.raises(ValueError, match="seven"):
        parser(int, KeyError)(b"seven")
    with pytest.raises(AssertionError):
        parser(int, ValueError, lambda value: b"%d" % (value + 1))(b"7")
    seen: list[bytes] = []
    one_of(seen.append, lambda data: None)(b"\x02ab")
    assert seen == [b"ab"]


def test_a_long_run_is_summed_from_its_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log.append(tmp_path, "cobs", log.Done(500, 2, 20, 47, 1))
    log.append(tmp_path, "link", log.Done(10, 1, 5, 40, 1))
    log.append(tmp_path, "cobs", log.Done(300, 2, 22, 46, 1))
    assert log.total(tmp_path, "cobs") == log.Done(800, 4, 22, 47, 2)
    assert main(["cobs", "--done", "--corpus", str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[1].split() == ["cobs", "800", "200", "22", "47"]
    if importlib.util.find_spec("atheris") is not None:
        assert main(["cobs", "--runs", "800", "--corpus", str(tmp_path)]) == 0  # nothing to do
        assert "800" in capsys.readouterr().out
        assert log.total(tmp_path, "cobs").pieces == 2
    with (tmp_path / log.NAME).open("a") as file:
        file.write("cobs,many\n")
    assert main(["cobs", "--done", "--corpus", str(tmp_path)]) == 2
    assert "executions.csv:5" in capsys.readouterr().err


def test_pieces_of_a_long_run_vary_in_seed_and_length() -> None:
    target = next(target for target in TARGETS if target.name == "pcap")
    pieces = [Piece.next(target, n, 10**7, None, 1, whole=False) for n in range(16)]
    assert [piece.seed for piece in pieces] == list(range(1, 17))
    assert [n for n, piece in enumerate(pieces) if piece.longest == target.longest] == [7, 15]
    assert {piece.runs for piece in pieces} == {PIECE_RUNS}
    assert Piece.next(target, 0, 7, 2.5, 1, whole=False) == Piece("pcap", target.usual, 1, 7, 2)
    assert Piece.next(target, 0, 7, None, 1, whole=True) == Piece("pcap", FILE, 1, 7, None)
