"""An emulated XBee module in the place of the base station, its serial port open to an operator.

`fishbed board xbee` and `[hil] xbee`: whoever opens the port has before him what an XBee on a USB
adapter is, on the air of the scenario, and steers the robot with it (`fishbed teleop`, XCTU, or a
program of his own). The module comes set up for the scenario, as by an earlier WR: channel, PAN and
own address of the base station, plain MAC (MM 2), API mode 2, 9600 baud.

At a pseudo-terminal the other side's baud rate can be seen, and where it is not the module's, what
goes over is what UARTs would make of it.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from msgspec.structs import asdict

from firmware_model.time import FS_PER_S, from_seconds
from radio_802154.xbee_module import XBeeModule, resampled
from spi_bus.transports.outage import OutageBegan
from spi_bus.transports.pty import PtyTransport
from tools.bench.outages import LineOutages, open_line
from tools.records.data import Event

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from radio_802154.air import Air
    from spi_bus.transports.base import Waitable
    from tools.configuration import Scenario

RESTART_S: Final = 0.5
"""How long the supply is away at each of `xbee_restarts_s`."""
HELD_OCTETS: Final = 4096
"""Said by the module and not taken by the line; beyond, octets are lost as on a wire."""
READ_OCTETS: Final = 1024


class XBeePort:
    """The module's serial port; a member of the run's `LineGroup`.

    Raises:
        ScenarioError: the port cannot be opened.

    """

    def __init__(self, config: Scenario, clock: Callable[[], float] = time.monotonic) -> None:
        hil, base, radio = config.hil, config.base_station, config.radio
        self.url = hil.xbee
        self.outages = LineOutages()
        self.octets_in = 0
        self.octets_out = 0
        self.octets_lost = 0
        """Said by the module while nobody took them."""
        self.misheard = 0
        """Octets that crossed at different baud rates."""
        power = {-10: 0, -7: 1, -5: 2, -3: 3, -1: 4, 0: 4}  # the nearest of the XBee's levels
        self._written = {
            "CH": radio.channel,
            "ID": radio.pan_id,
            "MY": base.address,
            "DL": config.procboard.address,
            "PL": power.get(radio.tx_power_dbm, 0),
            "SL": 0x4000_0000 | config.scenario.seed & 0xFF_FFFF,
            **asdict(hil.xbee_registers),
        }
        self._restarts_s = hil.xbee_restarts_s
        self._seed = config.scenario.seed
        self._module: XBeeModule | None = None
        self._events: list[Event] = []
        self._scheduler: Scheduler | None = None
        self._waiting: deque[bytes] = deque()
        self._powered = False
        self._out = bytearray()
        self._transport = open_line("xbee", self.url, clock, self.outages)
        self.where = self._transport.description

    def place(self, scheduler: Scheduler, air: Air, antenna: str) -> None:
        """Put the module at an antenna of the air."""
        self._scheduler = scheduler
        module = XBeeModule(scheduler, air, antenna, self._written, self._say, self._seed)
        self._module = module
        scheduler.at(0, self._power_on)
        for at_s in self._restarts_s:
            at_fs = from_seconds(at_s)
            scheduler.at(at_fs, lambda: self._switch(False))
            scheduler.at(at_fs + from_seconds(RESTART_S), lambda: self._switch(True))

    def _power_on(self) -> None:
        """Begin: what an operator said before the run, nobody heard."""
        self._transport.read()
        self._waiting.clear()
        self._powered = True

    def _switch(self, on: bool) -> None:
        assert self._module is not None
        assert self._scheduler is not None
        self._module.switch(on)
        words = "supply back, it boots" if on else "supply away"
        at_s = self._scheduler.now / FS_PER_S
        self._events.append(Event(at_s, "XBee module", words, "note" if on else "fault"))

    # --- a member of the group -------------------------------------------------------------

    def waitables(self) -> list[Waitable]:
        """Return the line."""
        return [self._transport]

    def poll(self) -> bool:
        """Move octets both ways; return whether some came."""
        data = self._transport.read(READ_OCTETS)
        if data:
            self.octets_in += len(data)
            self._waiting.append(data)
        self._flush()
        return bool(self._waiting)

    def on_incoming(self) -> None:
        """Let the module hear what came."""
        assert self._module is not None
        while self._waiting:
            data = self._waiting.popleft()
            if not self._powered:
                continue
            far = self._far_baud()
            if far is not None and far != self._module.baud:
                self.misheard += len(data)
                data = resampled(data, far, self._module.baud)
            self._module.receive(data)

    def _say(self, octets: bytes) -> None:
        assert self._module is not None
        far = self._far_baud()
        if far is not None and far != self._module.baud:
            self.misheard += len(octets)
            octets = resampled(octets, self._module.baud, far)
        room = HELD_OCTETS - len(self._out)
        self.octets_lost += max(0, len(octets) - room)
        self._out += octets[: max(0, room)]
        self._flush()

    def _flush(self) -> None:
        transport = self._transport
        count = min(len(self._out), transport.room)
        if count:
            transport.write(bytes(self._out[:count]))
            del self._out[:count]
            self.octets_out += count
        transport.flush()

    def _far_baud(self) -> int | None:
        """Return the baud rate that the other side of a pseudo-terminal has set, if it has."""
        line = getattr(self._transport, "line", self._transport)
        if not isinstance(line, PtyTransport):
            return None
        import termios

        code = termios.tcgetattr(line.fileno())[4]
        names = (name for name in dir(termios) if name[:1] == "B" and name[1:].isdigit())
        rates = {getattr(termios, name): int(name[1:]) for name in names}
        rate = rates.get(code)
        return None if rate == PTY_DEFAULT_BAUD else rate

    # --- what is known at the end ------------------------------------------------------------

    def events(self) -> list[Event]:
        """What happened to the module."""
        told = list(self._events)
        for event in self.outages.heard:
            # an operator's port has no time of the run: outages are counted, and told in words
            words = "lost" if isinstance(event, OutageBegan) else "back"
            told.append(Event(0.0, "XBee module", f"its serial port was {words}: {event.reason}"))
        return told

    def summary(self) -> dict[str, Any]:
        """Everything for a `summary.json`, under `hil.xbee`."""
        module = self._module
        assert module is not None
        return {
            "url": self.url,
            "port": self.where,
            "packets_sent": module.packets_sent,
            "packets_failed": module.packets_failed,
            "packets_received": module.packets_received,
            "restarts": module.restarts,
            "octets_in": self.octets_in,
            "octets_out": self.octets_out,
            "octets_lost": self.octets_lost,
            "misheard": self.misheard,
            "registers": {name: module.registers[name] for name in ("CH", "ID", "MY", "MM", "AP")},
            "outages": self.outages.summary(),
        }

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()


PTY_DEFAULT_BAUD: Final = 38_400
"""What a pseudo-terminal says before anybody has set a rate (Linux)."""


def words(xbee: dict[str, Any]) -> list[str]:
    """Lines on the module, for the terminal."""
    lines = [
        f"  {'XBee module':<14}at {xbee['port']}",
        (
            f"  {'by radio':<14}{xbee['packets_sent']} sent, {xbee['packets_failed']} failed, "
            f"{xbee['packets_received']} received"
        ),
        f"  {'by its port':<14}{xbee['octets_in']} octets in, {xbee['octets_out']} out",
    ]
    if xbee["misheard"]:
        lines.append(
            f"  {'':<14}{xbee['misheard']} of them at different baud rates: open the port at the "
            "module's"
        )
    if xbee["restarts"]:
        lines.append(f"  {'restarts':<14}{xbee['restarts']}")
    return lines
