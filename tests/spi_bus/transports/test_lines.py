"""Particulars of single transports that the kit, which is the same for all, does not ask."""

from __future__ import annotations

import can
import pytest

from spi_bus.errors import TransportLost
from spi_bus.transports import OpenContext, open_transport
from spi_bus.transports.can_bus import CanTransport
from spi_bus.transports.isotp import IsoTpConfig
from spi_bus.transports.pair import open_pair


def test_a_line_that_broke_while_writing_is_read_to_its_end_first() -> None:
    one, other = open_pair()
    other.write(b"last words")
    other.close()
    one.write(b"too late")  # nobody is told yet: there is something to read
    assert one.room == 0
    assert one.pending == 0
    with pytest.raises(TransportLost, match="gone"):
        one.write(b"x")
    assert one.read() == b"last words"
    with pytest.raises(TransportLost, match="gone"):
        one.read()
    one.close()


def test_others_on_the_bus_are_not_heard() -> None:
    base = "can://virtual/others"
    one = open_transport(f"{base}?tx=0x101&rx=0x201")
    other = open_transport(f"{base}?tx=0x201&rx=0x101")
    stranger = can.Bus("others", interface="virtual")
    for arbitration_id, extended, remote in (
        (0x200, False, False),
        (0x101, True, False),
        (0x101, False, True),
    ):
        stranger.send(
            can.Message(
                arbitration_id=arbitration_id,
                is_extended_id=extended,
                is_remote_frame=remote,
                data=None if remote else b"\x03bad",
                dlc=4,
            )
        )
    one.write(b"good")
    assert other.read() == b"good"
    assert other.failures == {}
    stranger.shutdown()
    one.close()
    other.close()


class FullBus:
    """An adapter whose queue is full for a while, and which then breaks."""

    def __init__(self) -> None:
        self.full = True
        self.broken = False
        self.sent: list[bytes] = []

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        assert timeout == 0
        if self.broken:
            raise can.CanOperationError("Network is down", 100)
        if self.full:
            raise can.CanOperationError("Transmit buffer full", 105)
        self.sent.append(bytes(message.data))

    def recv(self, timeout: float) -> None:
        del timeout

    def shutdown(self) -> None: ...


def test_a_full_adapter_is_tried_again_and_a_broken_one_is_lost() -> None:
    now = [5.0]
    bus = FullBus()
    transport = CanTransport(bus, 0x101, 0x201, IsoTpConfig(), lambda: now[0], "can")
    transport.write(b"hello")
    assert bus.sent == []
    assert transport.pending
    assert transport.next_deadline_s() == pytest.approx(5.001)
    bus.full = False
    transport.flush()
    assert bus.sent == [b"\x05hello\xcc\xcc"]
    assert not transport.pending
    assert transport.next_deadline_s() is None
    bus.broken = True
    transport.write(b"more")
    assert transport.room == 0
    with pytest.raises(TransportLost, match="Network is down"):
        transport.read()


def test_a_payload_that_nobody_takes_is_given_up_and_counted() -> None:
    now = [5.0]
    bus = FullBus()
    bus.full = False
    transport = CanTransport(bus, 0x101, 0x201, IsoTpConfig(), lambda: now[0], "can")
    transport.write(bytes(300))
    assert len(bus.sent) == 1
    assert transport.pending == 300 - 256
    assert transport.next_deadline_s() == pytest.approx(6.0)
    now[0] = 6.0
    assert transport.read() == b""
    assert transport.failures == {"N_TIMEOUT_Bs": 1}
    assert len(bus.sent) == 2, "the next payload begins"


def test_fd_frames_are_long_and_say_so() -> None:
    context = OpenContext()
    watcher = can.Bus("fd", interface="virtual", protocol=can.CanProtocol.CAN_FD)
    end = open_transport("can://virtual/fd?tx=0x101&rx=0x201&fd=1&brs=1", context)
    end.write(bytes(range(40)))
    message = watcher.recv(5.0)
    assert message is not None
    assert (message.is_fd, message.bitrate_switch, len(message.data)) == (True, True, 48)
    assert bytes(message.data[:3]) == b"\x00\x28\x00"
    watcher.shutdown()
    end.close()
