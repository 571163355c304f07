"""The operator's XBee: found out about, set up, sent through; octets and times in, events out.

At the start, and after every restart of the module or its line, it is asked for its mode and
addresses. The first question is one that has the same octets in both API modes, and both decoders
listen for the answer. Where none comes, +++ tells a module in transparent mode from one that is not
there or speaks another baud rate.

Packets are our active messages in plain IEEE 802.15.4 frames, so the module's MAC mode must be one
without Digi header (MM 1 or 2): else MM = 2 is set, and said. What is set is not written (WR): with
its supply the module forgets it.

Each request has a frame id and is kept until its status comes. What finds `MOST_IN_FLIGHT` without
one is not sent: the next setpoint is better than an old one repeated.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import Final

from firmware_model.histogram import DurationHistogram
from radio_802154 import messages, xbee
from radio_802154.errors import RadioError
from radio_802154.messages import CommandReply, Telemetry
from radio_802154.tinyos import NALP_DISPATCH
from radio_802154.xbee import (
    ApiFrame,
    AtCommand,
    AtResponse,
    AtResult,
    ModemStatus,
    RxPacket16,
    RxPacket64,
    TxRequest16,
    TxRequest64,
    TxResult,
    TxStatus,
)

ANSWER_S: Final = 1.0
"""For an AT command: two of the longest frames at 1200 baud take 0.5 s."""
TRIES: Final = 3
GUARD_S: Final = 1.2
"""Silence before and after +++: GT's default is 1 s."""
STATUS_S: Final = 2.0
"""After which a request counts as unanswered: the MAC's tries take 0.2 s, a slow line the rest."""
MOST_IN_FLIGHT: Final = 3
REMEMBERED: Final = 64
"""Commands whose reply is still waited for."""
PATIENCE_S: Final = 15.0
"""How long a silent line is asked: an emulated robot takes ten seconds to come up on a busy
machine. Where anything comes, one round is enough."""
RESTART_S: Final = 0.3
"""After a modem status, until the first question: the module boots."""
PLAIN_MAC: Final = (1, 2)
_PROBE: Final = AtCommand(0x52, b"AP")
"""Has no octet that API mode 2 escapes, so both modes read it."""


class Phase(Enum):
    """Where the module is."""

    PROBING = "looking for the module"
    GUARDING = "no answer: silence before +++"
    ESCAPING = "no answer: +++"
    SETTING_UP = "setting up"
    READY = "ready"
    FAILED = "no module"


@dataclass(frozen=True, slots=True)
class SetUp:
    """What the operator wants of the module; None leaves a register as it is."""

    channel: int | None = None
    pan_id: int | None = None
    own_address: int | None = None
    switch_to_api: bool = False
    """Whether a module in transparent mode is switched to API mode."""


@dataclass(frozen=True, slots=True)
class ModuleInfo:
    """What the module says it is."""

    firmware: int
    hardware: int
    serial_number: int
    channel: int
    pan_id: int
    own_address: int
    mac_mode: int
    api_mode: int

    def __str__(self) -> str:
        own = (
            f"{self.own_address:#06x}"
            if self.own_address < 0xFFFE
            else f"{self.serial_number:016X}"
        )
        return (
            f"XBee {self.hardware >> 8:02X}, firmware {self.firmware:04X}, API {self.api_mode}, "
            f"address {own}, PAN {self.pan_id:#06x}, channel {self.channel}"
        )


@dataclass(frozen=True, slots=True)
class Told:
    """Something that the operator should read."""

    text: str


@dataclass(frozen=True, slots=True)
class Ready:
    """Packets can be sent from now on."""

    info: ModuleInfo


@dataclass(frozen=True, slots=True)
class Failed:
    """There is no module to send through; one line with the remedy."""

    reason: str


@dataclass(frozen=True, slots=True)
class Restarted:
    """The module was reset; it is set up again."""


@dataclass(frozen=True, slots=True)
class Sent:
    """What became of a packet on the air."""

    command_id: int
    result: TxResult
    after_s: float


@dataclass(frozen=True, slots=True)
class Replied:
    """The fish answered a command."""

    reply: CommandReply
    after_s: float | None
    """None for one that was answered before, or of long ago."""


@dataclass(frozen=True, slots=True)
class Heard:
    """Telemetry of a fish, with the strength of its packet in dBm."""

    source: int
    telemetry: Telemetry


Event = Told | Ready | Failed | Restarted | Sent | Replied | Heard

_QUERIES: Final = ("AP", "VR", "HV", "SH", "SL", "CH", "ID", "MY", "MM")


class ModuleSession:
    """One module over its serial line.

    Args:
        set_up: what to set in it.
        now_s: the time; all times are of one monotonic clock, in seconds.

    """

    def __init__(self, set_up: SetUp, now_s: float) -> None:
        self.set_up = set_up
        self.phase = Phase.PROBING
        self.info: ModuleInfo | None = None
        self.rssi_dbm: int | None = None
        """Of the last packet that the module received."""
        self.results: Counter[str] = Counter()
        """Packets by what became of them: the names of `TxResult`, and `unanswered`."""
        self.replies: Counter[str] = Counter()
        """Answers of the fish, by the names of `CommandStatus`."""
        self.skipped = 0
        """Commands not sent because too many were under way."""
        self.restarts = 0
        self.foreign = 0
        """Packets that were none of ours."""
        self.repeated = 0
        """Replies that had been there before."""
        self.status_s = DurationHistogram()
        """From handing a request over until its status: serial line, air and back."""
        self.reply_s = DurationHistogram()
        """From the same until the fish's answer."""
        self._out = bytearray()
        self._both = (xbee.Decoder(escaped=False), xbee.Decoder(escaped=True))
        self._decoder: xbee.Decoder | None = None
        self._octets = 0
        self._text = bytearray()
        self._tries = 0
        self._began_s = now_s
        self._due_s: float | None = now_s
        self._frame_id = 0
        self._values: dict[str, int] = {}
        self._todo: list[tuple[str, int | None]] = []
        self._flights: OrderedDict[int, tuple[float, int]] = OrderedDict()
        self._waiting: OrderedDict[int, float] = OrderedDict()
        self._said: Counter[str] = Counter()

    # --- octets and time ---------------------------------------------------------------------

    def data_to_send(self) -> bytes:
        """Return what goes to the module now, once."""
        data, self._out = bytes(self._out), bytearray()
        return data

    @property
    def errors(self) -> int:
        """Frames from the module that were damaged."""
        return self._decoder.error_count if self._decoder is not None else 0

    @property
    def next_deadline_s(self) -> float | None:
        """When `handle_timer` has something to do."""
        dues = [] if self._due_s is None else [self._due_s]
        if self._flights:
            dues.append(next(iter(self._flights.values()))[0] + STATUS_S)
        return min(dues, default=None)

    def reopened(self, now_s: float) -> None:
        """The serial line was lost and is back: begin again."""
        self._begin(now_s)

    def receive(self, octets: bytes, now_s: float) -> list[Event]:
        """Take octets from the module."""
        self._octets += len(octets)
        if self.phase is Phase.ESCAPING:
            self._text += octets
            if b"OK\r" in self._text:
                return self._transparent(now_s)
        if self._decoder is not None:
            frames = self._decoder.receive(octets)
        else:
            frames = self._first_answer(octets)
        events: list[Event] = []
        for frame in frames:
            events += self._hear(frame, now_s)
        return events

    def handle_timer(self, now_s: float) -> list[Event]:
        """Do what is due."""
        for frame_id, (sent_s, _) in list(self._flights.items()):
            if now_s >= sent_s + STATUS_S:
                del self._flights[frame_id]
                self.results["unanswered"] += 1
        if self._due_s is None or now_s < self._due_s:
            return []
        self._due_s = None
        match self.phase:
            case Phase.PROBING:
                return self._probe(now_s)
            case Phase.GUARDING:
                self._text.clear()
                self._out += b"+++"
                self.phase, self._due_s = Phase.ESCAPING, now_s + 2 * GUARD_S
                return []
            case Phase.ESCAPING:
                if self._octets or now_s - self._began_s >= PATIENCE_S:
                    return self._fail(self._nothing_words())
                self._tries = 0
                self.phase, self._due_s = Phase.PROBING, now_s
                return []
            case Phase.SETTING_UP:
                if self._tries < TRIES:
                    self._ask(now_s)
                    return []
                return self._fail(
                    f"the module did not answer AT{self._todo[0][0]}: look at its cable"
                )
        return []

    def _begin(self, now_s: float) -> None:
        if self._flights:
            self.results["unanswered"] += len(self._flights)
        self._flights.clear()
        self._out.clear()
        self._both = (xbee.Decoder(escaped=False), xbee.Decoder(escaped=True))
        self._decoder = None
        self._octets = self._tries = 0
        self._began_s = now_s
        self.phase, self._due_s = Phase.PROBING, now_s

    # --- finding out -------------------------------------------------------------------------

    def _probe(self, now_s: float) -> list[Event]:
        if self._tries >= TRIES:
            self.phase, self._due_s = Phase.GUARDING, now_s + GUARD_S
            return []
        self._tries += 1
        self._out += xbee.encode(_PROBE, escaped=False)
        self._due_s = now_s + ANSWER_S
        return []

    def _first_answer(self, octets: bytes) -> list[ApiFrame]:
        """Listen in both modes, until one of them has the answer to the probe."""
        heard = [(decoder, decoder.receive(octets)) for decoder in self._both]
        for decoder, frames in heard:
            for frame in frames:
                if isinstance(frame, AtResponse) and frame.command == b"AP":
                    self._decoder = self._both[int.from_bytes(frame.value, "big") == 2]
                    return frames if decoder is self._decoder else [frame]
        return []

    def _nothing_words(self) -> str:
        if self._octets:
            return (
                f"{self._octets} octets came and no answer among them: is the baud rate the "
                "module's (BD; 9600 unless changed), as in serial:///dev/ttyUSB0?baud=9600, and is "
                "it an XBee?"
            )
        return (
            "nothing came: is the XBee on this port, and has the port its baud rate (BD; 9600 "
            "unless changed), as in serial:///dev/ttyUSB0?baud=9600?"
        )

    def _transparent(self, now_s: float) -> list[Event]:
        """The module has answered +++: switch it to API mode, or say how."""
        if not self.set_up.switch_to_api:
            self._out += b"ATCN\r"
            return self._fail(
                "the module is in transparent mode (AP = 0): start again with --set-api, or set "
                "AP to 1 or 2 with XCTU and write it"
            )
        self._out += b"ATAP2\rATCN\r"
        self._both = (xbee.Decoder(escaped=False), xbee.Decoder(escaped=True))
        self._tries = 0
        self.phase, self._due_s = Phase.PROBING, now_s + RESTART_S
        return [Told("the module was in transparent mode: API mode 2 until its supply goes")]

    def _fail(self, reason: str) -> list[Event]:
        self.phase, self._due_s = Phase.FAILED, None
        return [Failed(reason)]

    def _ask(self, now_s: float) -> None:
        name, value = self._todo[0]
        parameter = b""
        if value is not None:
            parameter = value.to_bytes(max(1, (value.bit_length() + 7) // 8), "big")
        self._tries += 1
        self._say(AtCommand(self._next_id(), name.encode(), parameter))
        self._due_s = now_s + ANSWER_S

    def _answered(self, answer: AtResponse, now_s: float) -> list[Event]:
        name = answer.command.decode("ascii", "replace")
        looking = (Phase.PROBING, Phase.GUARDING, Phase.ESCAPING)
        if self.phase in looking and name == "AP":
            self.phase = Phase.SETTING_UP
            self._todo = [(query, None) for query in _QUERIES]
            self._values.clear()
        elif self.phase is not Phase.SETTING_UP or name != self._todo[0][0]:
            return []
        else:
            wanted = self._todo[0][1]
            if answer.status != AtResult.OK:
                setting = "" if wanted is None else f" to {wanted:#x}"
                return self._fail(f"the module refused AT{name}{setting}: is it a Series 1 XBee?")
            self._values[name] = int.from_bytes(answer.value, "big") if wanted is None else wanted
            del self._todo[0]
        self._tries = 0
        events: list[Event] = []
        if not self._todo:
            events += self._to_set()
        if self._todo:
            self._ask(now_s)
            return events
        return [*events, *self._complete()]

    def _to_set(self) -> list[Event]:
        """Compare what the module has with what is wanted."""
        wanted = {
            "CH": self.set_up.channel,
            "ID": self.set_up.pan_id,
            "MY": self.set_up.own_address,
            "MM": None if self._values["MM"] in PLAIN_MAC else 2,
        }
        self._todo = [
            (name, value)
            for name, value in wanted.items()
            if value is not None and value != self._values[name]
        ]
        return [
            Told(f"{name} of the module is set from {self._values[name]:#x} to {value:#x}, until "
                 "its supply goes")
            for name, value in self._todo
        ]  # fmt: skip

    def _complete(self) -> list[Event]:
        values = self._values
        self.info = ModuleInfo(
            values["VR"], values["HV"], values["SH"] << 32 | values["SL"], values["CH"],
            values["ID"], values["MY"], values["MM"], values["AP"],
        )  # fmt: skip
        self.phase, self._due_s = Phase.READY, None
        return [Ready(self.info)]

    # --- sending -----------------------------------------------------------------------------

    def send(self, destination: int, message: object, command_id: int, now_s: float) -> bool:
        """Send a message of the base's to a fish; False, and nothing sent, where it has to wait.

        Raises:
            LocalFrameError: a value does not fit the message.

        """
        if self.phase is not Phase.READY:
            return False
        if len(self._flights) >= MOST_IN_FLIGHT:
            self.skipped += 1
            return False
        am_type, payload = messages.encode(message, messages.BASE)
        data = bytes((NALP_DISPATCH, am_type)) + payload
        frame_id = self._next_id()
        request: ApiFrame
        if destination <= xbee.BROADCAST_16:
            request = TxRequest16(frame_id, destination, 0, data)
        else:
            request = TxRequest64(frame_id, destination, 0, data)
        self._say(request)
        self._flights[frame_id] = (now_s, command_id)
        self._waiting[command_id] = now_s
        if len(self._waiting) > REMEMBERED:
            self._waiting.popitem(last=False)
        return True

    @property
    def in_flight(self) -> int:
        """Requests whose status has not come."""
        return len(self._flights)

    def _next_id(self) -> int:
        while True:
            self._frame_id = self._frame_id % 255 + 1  # 0 would ask for no status
            if self._frame_id not in self._flights:
                return self._frame_id

    def _say(self, frame: ApiFrame) -> None:
        escaped = self._decoder is not None and self._decoder is self._both[1]
        self._out += xbee.encode(frame, escaped=escaped)

    # --- hearing -----------------------------------------------------------------------------

    def _hear(self, frame: ApiFrame, now_s: float) -> list[Event]:
        match frame:
            case AtResponse():
                return self._answered(frame, now_s)
            case TxStatus(frame_id, status):
                return self._sent(frame_id, status, now_s)
            case ModemStatus(status) if status in (0, 1):
                self.restarts += 1
                self._begin(now_s + RESTART_S)
                return [Restarted()]
            case RxPacket16(source, rssi, _, data) | RxPacket64(source, rssi, _, data):
                self.rssi_dbm = -rssi
                return self._packet(source, data, now_s)
        return []

    def _sent(self, frame_id: int, status: int, now_s: float) -> list[Event]:
        flight = self._flights.pop(frame_id, None)
        if flight is None:
            return []
        try:
            result = TxResult(status)
        except ValueError:  # of another firmware: it was not sent, at any rate
            result = TxResult.PURGED
        self.results[result.name.lower()] += 1
        after_s = now_s - flight[0]
        self.status_s.record(after_s)
        return [Sent(flight[1], result, after_s)]

    def _packet(self, source: int, data: bytes, now_s: float) -> list[Event]:
        message: object = None
        if len(data) >= 2 and data[0] == NALP_DISPATCH:
            with suppress(RadioError):
                message = messages.decode(data[1], data[2:], messages.ROBOT)
        if message is None:
            self.foreign += 1
            return []
        if isinstance(message, Telemetry):
            return [Heard(source, message)]
        assert isinstance(message, CommandReply)
        sent_s = self._waiting.pop(message.command_id, None)
        if sent_s is None:
            self.repeated += 1
            return [Replied(message, None)]
        status = messages.CommandStatus(message.status) if message.status <= 4 else None
        self.replies[status.name.lower() if status is not None else "unknown"] += 1
        self.reply_s.record(now_s - sent_s)
        return [Replied(message, now_s - sent_s)]
