"""What goes wrong with a line, as a user of `hil` and of `board` meets it: one line, and exit 2.

It names the option that was given, what is wrong, and what to do. Lines on which the wrong thing
comes are recordings, played at their pace.
"""

from __future__ import annotations

import errno
import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from spi_bus.frame import VERSION
from spi_bus.link import Link, Role
from spi_bus.transports import open_transport
from tools.cli import main

COMMANDS = {
    "hil": (["hil", "--quiet", "--nav"], "--nav"),
    "board": (["board", "nav", "--on"], "--on"),
}
WRONG_URLS = {
    "no such port": ("serial:///dev/no-such-port", "no port /dev/no-such-port: this machine has"),
    "no port named": ("serial://", "which port? As serial:///dev/ttyUSB0?baud=115200"),
    "not a port": ("serial://{here}/file", "is that a serial port, and is it the right one?"),
    "baud is no number": ("serial:///dev/x?baud=fast", "baud='fast': not a whole number"),
    "no such option": ("serial:///dev/x?bauds=9600", "bauds"),
    "no URL": (
        "/dev/ttyUSB0",
        "is no transport URL: for a serial port write serial:///dev/ttyUSB0",
    ),
    "no such transport": ("seriell:///dev/x", "no transport is called 'seriell'"),
    "no such interface": ("can://socketcan/no0?tx=1&rx=2", "socketcan"),
    "no identifiers": ("can://virtual/x", "name two identifiers, tx and rx"),
    "no such kind of CAN": ("can://nosuch/x?tx=1&rx=2", "no interface 'nosuch'; there are"),
    "link path is a file": ("pty:?link={here}/file", "is there already and no link to a pty"),
    "link path in no folder": ("pty:?link={here}/none/nav", "no folder {here}/none for the link"),
    "nobody listens": ("socket://127.0.0.1:1", "is the server running there, and is the port"),
    "no RFC 2217 server": ("rfc2217://127.0.0.1:1", "is the server running there"),
    "no port number": ("socket://host", "write socket://host:port"),
    "recording exists": ("record:{here}/file:pty:", "exists and is not overwritten"),
    "no recording": ("replay:{here}/none", "cannot be read (No such file or directory)"),
    "not a recording": ("replay:{here}/file", "is no recording"),
    "both ends here": ("pair:x", "joins two ends in one process; pty: joins two programs"),
}


@pytest.fixture(params=COMMANDS)
def mistaken(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Iterator[Callable[..., str]]:  # fmt: skip
    """Call the command with a line; return its one line on stderr, without its place there."""
    monkeypatch.chdir(tmp_path)
    arguments, option = COMMANDS[request.param]

    def call(url: str, *more: str, opens: bool = False) -> str:
        assert main([*arguments, url, *more]) == 2
        told = capsys.readouterr().err.splitlines()
        assert len(told) == 1 + opens, told
        if opens:
            assert "the other board is expected at" in told[0]
            return told[1].removeprefix("fishbed: ")
        assert told[0].startswith(f"fishbed: {option}: "), told
        return told[0].removeprefix(f"fishbed: {option}: ")

    yield call
    assert not list(tmp_path.glob(".*"))  # nothing half-written


@pytest.mark.parametrize("case", WRONG_URLS)
def test_a_line_that_cannot_be_opened(
    case: str, mistaken: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("mine\n")
    url, says = (text.replace("{here}", str(tmp_path)) for text in WRONG_URLS[case])
    assert says in mistaken(url)
    assert (tmp_path / "file").read_text() == "mine\n"
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").iterdir())


def test_a_port_that_somebody_holds(mistaken: Callable[..., str], tmp_path: Path) -> None:
    pty = open_transport(f"pty:?link={tmp_path / 'port'}")
    holder = open_transport(f"serial://{tmp_path / 'port'}")
    try:
        says = mistaken(f"serial://{tmp_path / 'port'}")
        assert "is in use: close the program that holds it" in says
    finally:
        holder.close()
        pty.close()


def test_a_port_that_one_may_not_open(
    mistaken: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_args: Any, **_options: Any) -> Any:
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    says = mistaken("serial:///dev/ttyUSB0")
    assert "may not open" in says
    assert "usermod -aG dialout" in says


def recording(path: Path, data: bytes) -> str:
    """A recording of bytes that come twenty times a second for long; return its URL."""
    lines = [f"{0.05 * number:.6f} < {data.hex(' ')}" for number in range(400)]
    path.write_text("\n".join(["fishbed-transport-log 1", *lines]) + "\n")
    return f"replay:{path}"


def of_another_version() -> bytes:
    """A greeting of version 2 with its CRC right."""
    from spi_bus.cobs import encode
    from spi_bus.crc import crc16
    from spi_bus.frame import Decoder

    (body,) = Decoder().receive(Link(Role.SLAVE, 3).data_to_send(0))
    body = bytes([(VERSION + 1) << 4 | body[0] & 15]) + body[1:]
    return encode(body + crc16(body).to_bytes(2, "big")) + b"\0"


COMES = {
    "wrong baud rate": (
        random.Random(5).randbytes(40), "no frame was intact: is the baud rate the same",
    ),
    "another version": (
        of_another_version(),
        f"speaks version {VERSION + 1} of the link, this is {VERSION}: install",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", COMES)
def test_a_line_on_which_the_wrong_thing_comes(
    case: str, mistaken: Callable[..., str], tmp_path: Path
) -> None:
    data, says = COMES[case]
    url = recording(tmp_path / "line.log", data)
    assert says in mistaken(url, "--duration", "0.5", opens=True)


def test_a_line_that_gives_back_what_it_gets(mistaken: Callable[..., str]) -> None:
    says = mistaken("loop://", "--duration", "2", opens=True)
    assert "our own frames come back: is TX wired to RX of the same side?" in says


def test_a_line_on_which_nobody_answers(mistaken: Callable[..., str], tmp_path: Path) -> None:
    says = mistaken("pty:", "--duration", "0.5", opens=True)
    assert "nothing came: is the other side running, and the cable in?" in says
    for summary in tmp_path.glob("runs/*/summary.json"):  # of hil: written all the same
        assert json.loads(summary.read_text(encoding="utf-8"))["hil"]["diagnosis"] == says
