"""CAN by python-can, any interface: the byte stream goes in ISO-TP payloads.

    can://INTERFACE/CHANNEL?tx=0x123&rx=0x321&bitrate=1000000

What was written while a payload is under way goes together into the next, at most `payload` bytes:
256 is the largest link frame with its zero, so that a damaged payload costs one frame, and a board
needs no larger buffer. Identifiers above 0x7FF are extended ones. Options that are not ours go to
python-can as they are.

An adapter whose queue is full keeps us waiting: the frame is tried again, the outbox fills, `room`
falls to 0. Interfaces without a descriptor (`virtual`, some adapters) are waited for by
python-can's own `recv`.
"""

from __future__ import annotations

import errno
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final

from spi_bus.errors import (
    CanInterfaceError,
    MissingPackageError,
    PortNotFoundError,
    TransportClosedError,
    TransportError,
    TransportLost,
    TransportUrlError,
)
from spi_bus.transports.base import BUFFER_BYTES, READ_BYTES, Clock, OpenContext, Outbox, wait_any
from spi_bus.transports.isotp import IsoTp, IsoTpConfig, Payload, ReceiveFailed, SendFailed
from spi_bus.transports.urls import Url, boolean, integer, nearest, number, take

__all__ = ["CanTransport", "open_url"]

PAYLOAD_BYTES: Final = 256
_STANDARD_ID: Final = 0x7FF
_EXTENDED_ID: Final = 0x1FFF_FFFF
_ARRIVED_BYTES: Final = 65_536
_FULL: Final = frozenset((errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK))
_RETRY_S: Final = 0.001  # a frame of 8 bytes takes 0.13 ms at 1 Mbit/s, 1 ms at 125 kbit/s

OPTIONS: Final[dict[str, Callable[[str], Any]]] = {
    "tx": integer(0, _EXTENDED_ID),
    "rx": integer(0, _EXTENDED_ID),
    "fd": boolean,
    "brs": boolean,
    "block": integer(0, 255),
    "stmin_ms": number(0.0, 127.0),
    "timeout_ms": number(1.0, 60_000.0),
    "payload": integer(1, 4095),
    "padding": lambda text: None if text == "none" else integer(0, 255)(text),
}
"""Ours; `bitrate` and all others are python-can's."""

DEFAULTS: Final[dict[str, dict[str, Any]]] = {
    "slcan": {"timeout": 0.0},  # its reads would wait a millisecond for a byte that is not there
}
"""Options of an interface where python-can's own default does not suit."""


class CanTransport:
    """A byte stream over one CAN identifier each way.

    Args:
        bus: an open python-can bus; closed by `close`.
        transmit, receive: identifiers that we send and listen to.
        config: ISO-TP's sizes and times; `frame_bytes` over 8 sends CAN FD frames.
        bit_rate_switch: send FD frames' data at the data bit rate.
        payload_bytes: most stream bytes in one ISO-TP payload.
        clock: monotonic, in seconds.

    """

    openings = 1
    wants_writable = False  # a CAN socket is writable while its queue is full: tried again by time

    def __init__(
        self,
        bus: Any,
        transmit: int,
        receive: int,
        config: IsoTpConfig,
        clock: Clock,
        description: str,
        bit_rate_switch: bool = False,
        payload_bytes: int = PAYLOAD_BYTES,
    ) -> None:
        self._bus = bus
        self._transmit = transmit
        self._receive = receive
        self._isotp = IsoTp(config)
        self._clock = clock
        self._description = description
        self._bit_rate_switch = bit_rate_switch
        self._payload_bytes = payload_bytes
        self._outbox = Outbox(BUFFER_BYTES)
        self._frame = b""  # one that the adapter did not take
        self._retry_s = 0.0
        self._arrived = bytearray()
        self._ahead: deque[Any] = deque()  # messages that `wait` received
        self._broken: str | None = None
        self._closed = False
        self.failures: Counter[str] = Counter()
        """Payloads given up, by ISO-TP's result."""
        self.frames_sent = 0
        self.frames_received = 0

    @property
    def description(self) -> str:
        """What this is, and where."""
        return self._description

    @property
    def room(self) -> int:
        """Bytes that `write` takes now."""
        return 0 if self._broken is not None or self._closed else self._outbox.room

    @property
    def pending(self) -> int:
        """Bytes not segmented yet, or 1 while a payload's frames are still to go."""
        return len(self._outbox) or int(self._isotp.sending or bool(self._frame))

    def read(self, limit: int = READ_BYTES) -> bytes:
        """Return what has arrived in whole payloads; see `Transport`."""
        self._check_open()
        self.flush()
        data = bytes(self._arrived[:limit])
        del self._arrived[: len(data)]
        if not data and limit and self._broken is not None:
            raise self._lost(self._broken)
        return data

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Transport`."""
        self._check_open()
        if self._broken is not None:
            raise self._lost(self._broken)
        self._outbox.add(data)
        self.flush()

    def flush(self) -> None:
        """Take frames from the bus, flow control among them, and send as far as that lets us."""
        self._segment()
        while len(self._arrived) < _ARRIVED_BYTES and (message := self._next_message()):
            if (
                message.arbitration_id == self._receive
                and message.is_extended_id == (self._receive > _STANDARD_ID)
                and not (message.is_error_frame or message.is_remote_frame)
            ):
                self.frames_received += 1
                self._note(self._isotp.receive(bytes(message.data), self._now_us()))
                self._segment()  # our flow control, or what the peer's lets go

    def _segment(self) -> None:
        if self._closed or self._broken is not None:
            return
        self._note(self._isotp.handle_timer(self._now_us()))
        while self._broken is None:
            if not self._frame:
                if not self._isotp.sending and self._outbox:
                    payload = self._outbox.first(self._payload_bytes)
                    self._outbox.drop(len(payload))
                    self._isotp.send(payload)
                self._frame, events = self._isotp.next_frame(self._now_us())
                self._note(events)
            if not self._frame or not self._send(self._frame):
                return
            self._frame = b""

    def fileno(self) -> int:
        """Return the bus's descriptor, -1 where it has none."""
        if self._closed:
            return -1
        try:
            return int(self._bus.fileno())
        except (NotImplementedError, OSError):
            return -1

    def next_deadline_s(self) -> float | None:
        """Return when ISO-TP or a full adapter wants `flush`."""
        if self._closed:
            return None
        if self._arrived or self._ahead:
            return self._clock()  # read already, and not by the descriptor's account
        if self._frame:
            return self._retry_s
        deadline_us = self._isotp.next_deadline_us()
        return None if deadline_us is None else deadline_us / 1e6

    def wait(self, timeout_s: float) -> None:
        """Block until a frame may have come or ISO-TP has something to do."""
        self._check_open()
        if self._broken is not None or self._ahead or self._arrived:
            return
        deadline_s = self.next_deadline_s()
        if deadline_s is not None:
            timeout_s = min(timeout_s, deadline_s - self._clock())
        if self.fileno() >= 0:
            wait_any((self,), timeout_s, self._clock)
        elif (message := self._take(max(0.0, timeout_s))) is not None:
            self._ahead.append(message)

    def close(self) -> None:
        """Leave the bus."""
        if not self._closed:
            self._closed = True
            self._outbox.clear()
            self._bus.shutdown()

    def _now_us(self) -> int:
        return round(self._clock() * 1e6)

    def _next_message(self) -> Any:
        return self._ahead.popleft() if self._ahead else self._take(0.0)

    def _take(self, timeout_s: float) -> Any:
        import can

        if self._broken is not None or self._closed:
            return None
        try:
            return self._bus.recv(timeout_s)
        except (can.CanError, OSError) as error:
            self._broken = str(error)
        except (ValueError, IndexError, UnicodeDecodeError):
            self.failures["garbled"] += 1  # python-can's slcan does not check what it parses
        return None

    def _send(self, frame: bytes) -> bool:
        import can

        message = can.Message(
            arbitration_id=self._transmit,
            is_extended_id=self._transmit > _STANDARD_ID,
            is_fd=self._isotp.config.frame_bytes > 8,
            bitrate_switch=self._bit_rate_switch,
            data=frame,
        )
        try:
            self._bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            code = getattr(error, "error_code", None) or getattr(error, "errno", None)
            if code in _FULL or isinstance(error, can.CanTimeoutError):
                self._retry_s = self._clock() + _RETRY_S
            else:
                self._broken = str(error)
            return False
        self.frames_sent += 1
        return True

    def _note(self, events: list[Any]) -> None:
        for event in events:
            if isinstance(event, Payload):
                self._arrived += event.data
            elif isinstance(event, (SendFailed, ReceiveFailed)):
                self.failures[event.result] += 1

    def _check_open(self) -> None:
        if self._closed:
            raise TransportClosedError(f"{self._description} was closed: open it again")

    def _lost(self, reason: str) -> TransportLost:
        return TransportLost(f"{self._description}: the adapter is gone ({reason})")


def open_url(url: Url, context: OpenContext) -> CanTransport:
    """Open `can://interface/channel?tx=…&rx=…`.

    Raises:
        TransportUrlError: identifiers or interface missing, or a wrong option.
        CanInterfaceError: python-can does not know it, or this machine does not have it.
        PortNotFoundError: no such channel.
        MissingPackageError: python-can, or what the interface needs, is not installed.

    """
    example = "can://socketcan/can0?tx=0x101&rx=0x201"
    try:
        import can
        from can.interfaces import VALID_INTERFACES
    except ImportError as error:
        raise MissingPackageError(
            f"{url.text}: CAN needs python-can: pip install python-can"
        ) from error
    others: dict[str, str] = {}
    options = take(url, OPTIONS, leftover=others)
    interface, _, channel = url.rest.removeprefix("//").partition("/")
    if not url.rest.startswith("//") or not interface or not channel:
        raise TransportUrlError(f"{url.text}: write can://interface/channel, as {example}")
    if interface not in VALID_INTERFACES:
        raise CanInterfaceError(
            f"{url.text}: python-can has no interface {interface!r}"
            f"{nearest(interface, sorted(VALID_INTERFACES))}"
        )
    if "tx" not in options or "rx" not in options or options["tx"] == options["rx"]:
        raise TransportUrlError(f"{url.text}: name two identifiers, tx and rx, as {example}")
    try:
        config = _config(options)
    except ValueError as error:
        raise TransportUrlError(f"{url.text}: {error}") from error
    arguments = {**DEFAULTS.get(interface, {}), **_python_values(others)}
    fd = options.get("fd", False)
    if fd:
        arguments.setdefault("fd", True)
        if interface == "virtual":
            arguments["protocol"] = can.CanProtocol.CAN_FD
    try:
        bus = can.Bus(channel, interface=interface, **arguments)
    except Exception as error:  # interfaces raise what they like; each is a way of not opening
        raise _open_error(url, interface, channel, error) from error
    return CanTransport(
        bus,
        options["tx"],
        options["rx"],
        config,
        context.clock,
        f"can {interface} {channel}, sends 0x{options['tx']:X}, hears 0x{options['rx']:X}"
        + (", FD" if fd else ""),
        options.get("brs", False),
        options.get("payload", PAYLOAD_BYTES),
    )


def _config(options: dict[str, Any]) -> IsoTpConfig:
    timeout_us = round(options.get("timeout_ms", 1_000.0) * 1_000)
    return IsoTpConfig(
        frame_bytes=64 if options.get("fd") else 8,
        block_size=options.get("block", 0),
        separation_us=round(options.get("stmin_ms", 0.0) * 1_000),
        padding=options.get("padding", 0xCC),
        flow_timeout_us=timeout_us,
        frame_timeout_us=timeout_us,
    )


def _python_values(texts: dict[str, str]) -> dict[str, Any]:
    """Numbers and truth values as such: python-can checks types itself."""
    values: dict[str, Any] = {}
    for name, text in texts.items():
        for convert in (lambda text: int(text, 0), float, boolean):
            try:
                values[name] = convert(text)
                break
            except ValueError:
                continue
        else:
            values[name] = text
    return values


def _open_error(url: Url, interface: str, channel: str, error: Exception) -> TransportError:
    import can

    reason = str(error) or type(error).__name__
    cause = error.__cause__
    if isinstance(error, ImportError) or isinstance(cause, ImportError) or "msgpack" in reason:
        return MissingPackageError(
            f"{url.text}: {interface} needs a package that is not installed ({reason}): "
            f"see python-can's page on {interface}"
        )
    code = getattr(error, "errno", None) or getattr(cause, "errno", None)
    if code in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT) or "AF_CAN" in reason:
        return CanInterfaceError(
            f"{url.text}: this kernel has no {interface} (modprobe can_raw); without hardware use "
            "can://virtual/… in one process or can://udp_multicast/239.74.163.2 between several"
        )
    if code in (errno.ENODEV, errno.ENOENT, errno.ENXIO):
        return PortNotFoundError(
            f"{url.text}: no channel {channel}: plug the adapter in, then "
            f"ip link set {channel} up type can bitrate 1000000"
            if interface == "socketcan"
            else f"{url.text}: no channel {channel}: is the adapter in, and is its path right?"
        )
    if isinstance(error, (can.CanInterfaceNotImplementedError, AttributeError)):
        return CanInterfaceError(f"{url.text}: this machine has no {interface} ({reason})")
    if isinstance(error, (ValueError, TypeError)):
        return TransportUrlError(
            f"{url.text}: {reason}: see docs/transports.md and python-can's page on {interface}"
        )
    return CanInterfaceError(
        f"{url.text}: {interface} {channel} cannot be opened ({reason}): is the adapter in, and "
        "does nobody else hold it?"
    )
