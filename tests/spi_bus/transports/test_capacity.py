"""How long frames take: figures worked out by hand, and frames counted by another ISO-TP."""

from __future__ import annotations

import pytest

from spi_bus.errors import TransportUrlError
from spi_bus.frame import Frame, FrameType
from spi_bus.transports.capacity import FRAME_OVERHEAD, LineSpeed, line_speed

isotp = pytest.importorskip("isotp")


@pytest.mark.parametrize(
    ("url", "bits_per_s", "bits_per_byte"),
    [
        ("serial:///dev/x", 115_200, 10),
        ("serial:///dev/x?baud=9600", 9_600, 10),
        ("serial:///dev/x?baud=9600&parity=E&stopbits=2", 9_600, 12),
        ("serial:///dev/x?bytesize=7", 115_200, 9),
        ("rfc2217://host:1?baud=57600", 57_600, 10),
        ("record:a.log:serial:///dev/x?baud=19200", 19_200, 10),
    ],
)
def test_a_serial_url_says_its_speed(url: str, bits_per_s: float, bits_per_byte: float) -> None:
    speed = line_speed(url)
    assert speed is not None
    assert (speed.bits_per_s, speed.bits_per_byte, speed.shared) == (
        bits_per_s, bits_per_byte, False,
    )  # fmt: skip


@pytest.mark.parametrize(
    "url", ["pty:", "pair:x", "socket://h:1", "can://socketcan/can0?tx=1&rx=2", "replay:x.log"]
)
def test_others_say_nothing(url: str) -> None:
    assert line_speed(url) is None


def test_no_url_is_one_line() -> None:
    with pytest.raises(TransportUrlError):
        line_speed("/dev/ttyUSB0")
    with pytest.raises(TransportUrlError):
        line_speed("serial:///dev/x?baud=fast")
    with pytest.raises(TransportUrlError):
        line_speed("can://socketcan/can0?bitrate=quick")


def test_a_frame_on_a_serial_line() -> None:
    """60 bytes of payload at 115 200 baud: 69 bytes of ten bits, 5.99 ms."""
    frame = Frame(FrameType.DATA, 0, 0, 0, 0, 0, bytes(60)).encode()
    assert len(frame) == 60 + FRAME_OVERHEAD == 69
    assert LineSpeed(115_200).seconds(60) == pytest.approx(690 / 115_200)


@pytest.mark.parametrize("payload", [0, 1, 4, 10, 60, 247 - 9])
def test_frames_on_can_are_those_that_iso_tp_sends(payload: int) -> None:
    """Counted by another implementation; the flow control frame comes on top."""
    sent: list[object] = []
    link_frame = bytes(payload + FRAME_OVERHEAD)
    address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x101, rxid=0x201)
    answers = [isotp.CanMessage(arbitration_id=0x201, data=bytes((0x30, 0, 0)))]

    def receive(timeout: float = 0.0) -> object:
        return answers.pop() if sent and answers else None

    layer = isotp.TransportLayerLogic(receive, sent.append, address)
    layer.send(link_frame)
    for _ in range(200):
        layer.process()
    speed = line_speed("can://socketcan/can0?tx=0x101&rx=0x201&bitrate=1000000")
    assert speed is not None
    assert speed.shared
    flow = len(sent) > 1
    assert speed.seconds(payload) == pytest.approx((len(sent) + flow) * 135e-6)
    extended = line_speed("can://socketcan/can0?tx=0x18DA0001&rx=0x201&bitrate=500000")
    assert extended is not None
    assert extended.seconds(payload) == pytest.approx((len(sent) + flow) * 320e-6)
