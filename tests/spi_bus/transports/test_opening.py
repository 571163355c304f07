"""What a user meets when a transport does not open: one clear line each, with what to do."""

from __future__ import annotations

import builtins
import os
import pty
import socket
import sys
import tty
from pathlib import Path

import pytest

from spi_bus import errors
from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.base import wait_any
from spi_bus.transports.urls import parse

NO_CAN = not hasattr(socket, "AF_CAN")


def message(url: str, kind: type[Exception], builtin: type[Exception]) -> str:
    with pytest.raises(kind) as caught:
        open_transport(url, OpenContext())
    assert isinstance(caught.value, errors.TransportError)
    assert isinstance(caught.value, builtin)
    text = str(caught.value)
    assert "\n" not in text
    assert text == " ".join(text.split())
    return text


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("", "write for example pty:"),
        ("/dev/ttyUSB0", "write serial:///dev/ttyUSB0?baud=115200"),
        ("COM3", "write serial://COM3?baud=115200"),
        ("seriel:///dev/ttyUSB0", "did you mean serial?"),
        ("quic://x", "there are pair, pty, serial"),
        ("serial:", "which port?"),
        ("serial:///dev/ttyUSB0?baud=fast", "baud='fast': not a whole number"),
        ("serial:///dev/ttyUSB0?baud=0", "outside 1 to"),
        ("serial:///dev/ttyUSB0?boud=9600", "has no option 'boud'; did you mean baud?"),
        ("serial:///dev/ttyUSB0?baud=1&baud=2", "given twice"),
        ("serial:///dev/ttyUSB0?9600", "?name=value"),
        ("serial:///dev/ttyUSB0?parity=X", "not one of N, E, O"),
        ("serial:///dev/ttyUSB0?rtscts=perhaps", "not yes or no"),
        ("spy:///dev/null?nonsense=1", "see docs/transports.md"),
        ("socket://localhost", "write socket://host:port"),
        ("socket://localhost:port", "write socket://host:port"),
        ("can:virtual", "write can://interface/channel"),
        ("can://virtual/x", "two identifiers, tx and rx"),
        ("can://virtual/x?tx=1&rx=1", "two identifiers, tx and rx"),
        ("can://virtual/x?tx=0x20000000&rx=1", "outside 0 to"),
        ("can://virtual/x?tx=1&rx=2&stmin_ms=0.25", "no STmin"),
        ("can://slcan//dev/null?tx=1&rx=2&bitrate=12345&sleep_after_open=0", "can"),
        ("record:swim.log", "record:FILE:URL"),
        ("replay:", "which file?"),
        ("replay:x.log?pace=slow", "there are recorded, at-once"),
        ("pty:?lnk=x", "did you mean link?"),
    ],
)
def test_a_wrong_url_says_what_is_right(url: str, words: str) -> None:
    if "slcan" in url:
        pytest.importorskip("can")
        text = message(url, errors.TransportError, Exception)
    else:
        text = message(url, errors.TransportUrlError, ValueError)
    assert words in text


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    text = message(f"serial://{tmp_path}/nothing", errors.PortNotFoundError, FileNotFoundError)
    assert f"no port {tmp_path}/nothing" in text
    text = message(f"serial://{tmp_path}", errors.PortNotFoundError, OSError)
    assert "is that a serial port" in text


def test_a_file_that_is_no_port(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("")
    assert "is that a serial port" in message(f"serial://{path}", errors.PortNotFoundError, OSError)


def test_a_port_that_may_not_be_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = os.open

    def refuse(path: str, *arguments: object) -> int:
        if path == "/dev/ttyUSB0":
            raise PermissionError(13, "Permission denied")
        return opened(path, *arguments)

    monkeypatch.setattr("os.open", refuse)
    text = message("serial:///dev/ttyUSB0", errors.PortPermissionError, PermissionError)
    assert "usermod -aG dialout" in text


def test_a_port_that_another_program_holds() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    url = f"serial://{os.ttyname(theirs)}"
    holder = open_transport(url)
    text = message(url, errors.PortBusyError, BlockingIOError)
    assert "close the program that holds it" in text
    open_transport(f"{url}?exclusive=no").close()
    holder.close()
    open_transport(url).close()
    os.close(ours)
    os.close(theirs)


def test_nobody_at_a_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    text = message(f"socket://127.0.0.1:{port}", errors.PortNotFoundError, OSError)
    assert "is the server running there" in text
    text = message(f"rfc2217://127.0.0.1:{port}", errors.PortNotFoundError, OSError)
    assert "is the server running there" in text


def test_can_interfaces_that_are_not_there() -> None:
    text = message("can://soketcan/can0?tx=1&rx=2", errors.CanInterfaceError, RuntimeError)
    assert "did you mean socketcan?" in text
    text = message("can://socketcan/can9?tx=1&rx=2", errors.TransportError, Exception)
    assert "modprobe" in text or "ip link set can9" in text or "has no socketcan" in text
    text = message("can://pcan/PCAN_USBBUS1?tx=1&rx=2", errors.TransportError, Exception)
    assert "pcan" in text
    text = message(
        "can://slcan//dev/nothing?tx=1&rx=2", errors.PortNotFoundError, FileNotFoundError
    )
    assert "is the adapter in" in text


@pytest.mark.parametrize(
    ("package", "url"),
    [("serial", "serial:///dev/ttyUSB0"), ("can", "can://virtual/x?tx=1&rx=2")],
)
def test_packages_that_are_not_installed(
    package: str, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    imported = builtins.__import__

    def without(name: str, *arguments: object, **named: object) -> object:
        if name.split(".")[0] == package:
            raise ImportError(f"No module named {name!r}")
        return imported(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    text = message(url, errors.MissingPackageError, ImportError)
    assert "pip install" in text


def test_multicast_without_msgpack(monkeypatch: pytest.MonkeyPatch) -> None:
    import can.interfaces.udp_multicast.utils as utils

    monkeypatch.setattr(utils, "msgpack", None)
    text = message(
        "can://udp_multicast/239.74.163.2?tx=1&rx=2", errors.MissingPackageError, ImportError
    )
    assert "not installed" in text


def test_a_pty_links_where_it_may(tmp_path: Path) -> None:
    link = tmp_path / "nav"
    transport = open_transport(f"pty:?link={link}")
    assert os.readlink(link) == transport.path
    assert str(link) in transport.description
    assert transport.path in transport.description
    transport.close()
    assert not link.is_symlink()
    link.symlink_to("/dev/pts/99999")  # left over from a program that was killed
    again = open_transport(f"pty:?link={link}")
    assert os.readlink(link) == again.path
    again.close()
    link.write_text("precious")
    assert "is there already" in message(f"pty:?link={link}", errors.PortBusyError, BlockingIOError)
    assert link.read_text() == "precious"
    text = message(f"pty:?link={tmp_path}/no/nav", errors.PortNotFoundError, OSError)
    assert "no folder" in text


def test_a_link_to_a_pty_that_is_open_is_left_to_its_program(tmp_path: Path) -> None:
    link = tmp_path / "nav"
    first = open_transport(f"pty:?link={link}")
    text = message(f"pty:?link={link}", errors.PortBusyError, BlockingIOError)
    assert f"{link} is there already and leads to {first.path}, which a program has open" in text
    assert os.readlink(link) == first.path
    first.close()


def test_a_link_that_was_left_over_may_lead_to_the_new_pty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system numbers ptys anew: after a program was killed the next one gets its number."""
    ends = pty.openpty()
    monkeypatch.setattr("pty.openpty", lambda: ends)
    link = tmp_path / "nav"
    link.symlink_to(os.ttyname(ends[1]))
    transport = open_transport(f"pty:?link={link}")
    assert os.readlink(link) == transport.path
    transport.close()


def test_a_pty_lets_the_other_side_come_and_go() -> None:
    transport = open_transport("pty:")
    for text in (b"first", b"second"):
        far = os.open(transport.path, os.O_RDWR | os.O_NOCTTY)
        os.write(far, text)
        transport.wait(10.0)
        assert transport.read() == text
        transport.write(b"raw\n\x03\x00\r")
        assert os.read(far, 100) == b"raw\n\x03\x00\r"
        os.close(far)
        assert transport.read() == b""
    transport.close()


def test_several_are_waited_for_at_once() -> None:
    context = OpenContext()
    one, other = open_transport("pair:x", context), open_transport("pair:x", context)
    loop = open_transport("loop://")
    wait_any((one, other), 0.0, context.clock)
    one.write(b"1")
    while not (found := other.read()):
        wait_any((one, other), 10.0, context.clock)
    assert found == b"1"
    wait_any((other, loop), 0.01, context.clock)
    loop.write(b"2")
    while not (found := loop.read()):
        wait_any((one, other, loop), 10.0, context.clock)
    assert found == b"2"
    for transport in (one, other, loop):
        transport.close()


def test_a_waiting_end_whose_other_one_closed_is_not_given_out() -> None:
    context = OpenContext()
    open_transport("pair:x", context).close()
    one, other = open_transport("pair:x", context), open_transport("pair:x", context)
    one.write(b"hello")
    assert other.read() == b"hello"
    assert context.pairs == {}
    one.close()
    other.close()


def test_a_url_is_taken_apart() -> None:
    url = parse("CAN://slcan//dev/tty%20x@115200?tx=0x1&bitrate=1000000")
    assert (url.scheme, url.rest) == ("can", "//slcan//dev/tty x@115200")
    assert url.options == {"tx": "0x1", "bitrate": "1000000"}


@pytest.mark.skipif(sys.platform != "linux" or NO_CAN, reason="no AF_CAN in this Python")
def test_socketcan_where_the_kernel_has_it() -> None:
    try:
        probe = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        pytest.skip(f"this kernel has no CAN: {error}")
    probe.close()
    text = message("can://socketcan/nocan7?tx=1&rx=2", errors.PortNotFoundError, OSError)
    assert "ip link set nocan7" in text
