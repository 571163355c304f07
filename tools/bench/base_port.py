"""The USB port of the emulated base station on a line of this machine: a mote for host tools.

Octets cross in both directions at the pace of the UART, never faster. What a host does not read
fills the line (a pty keeps 4 KiB) and is lost from then on, an octet at a time, as on a real desk;
the frames that it tears fail their CRC at the host.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from firmware_model.power import Rail
from firmware_model.time import FS_PER_S
from procboard.chips.ft232 import BITS, BUFFER_OCTETS
from procboard.serial_base import SerialBaseStation
from radio_802154.tinyos_serial import BAUD
from tools.bench.outages import LineOutages, open_line
from tools.bench.power import PROC_V

if TYPE_CHECKING:
    from firmware_model.trace import Trace
    from procboard.network import NetworkConfig
    from radio_802154.medium import Medium
    from spi_bus.transports.base import Waitable
    from tools.bench.pace import LineScheduler
    from tools.configuration import Scenario
    from tools.records.data import Event

KEPT_OCTETS = 4096
"""Of the host's, before the line is left to wait: what a pty keeps."""
REFILL_FS = BUFFER_OCTETS // 2 * BITS * FS_PER_S // BAUD
"""Time in which half the converter's buffer has gone out."""


class BasePort:
    """The line at the port, and the mote behind it.

    Raises:
        ScenarioError: the line cannot be opened; the text is one line with the remedy.

    """

    def __init__(self, config: Scenario, clock: Callable[[], float] = time.monotonic) -> None:
        self.url = config.hil.base_port
        self.outages = LineOutages()
        self.lost_octets = 0
        """Octets of the mote that the line did not take."""
        self.base: SerialBaseStation | None = None
        self._config = config
        self.transport = open_line("base_port", self.url, clock, self.outages)
        self.where = self.transport.description
        self._waiting: deque[int] = deque()
        self._refill = False
        self._scheduler: LineScheduler | None = None

    def start(
        self, scheduler: LineScheduler, trace: Trace, medium: Medium, network: NetworkConfig
    ) -> None:
        """Power the mote, at the antenna `base` of the medium."""
        self._scheduler = scheduler
        self.base = SerialBaseStation(
            scheduler,
            trace,
            Rail(scheduler, "base 3 V", PROC_V),
            medium,
            network,
            self._to_host,
            "base",
            self._config.scenario.seed,
        )

    def waitables(self) -> list[Waitable]:
        """Return what to wait on."""
        return [self.transport]

    def poll(self) -> bool:
        """Take what the host has written, and hand on what it has not read."""
        room = KEPT_OCTETS - len(self._waiting)
        data = self.transport.read(room) if room > 0 else b""
        self.transport.flush()
        self._waiting.extend(data)
        return bool(data)

    def on_incoming(self) -> None:
        """Give the converter what it has room for, now and whenever half of that has gone."""
        assert self.base is not None
        usb, waiting = self.base.usb, self._waiting
        usb.send(bytes(waiting.popleft() for _ in range(min(usb.room, len(waiting)))))
        if waiting and not self._refill:
            assert self._scheduler is not None
            self._refill = True
            self._scheduler.after(REFILL_FS, self._again)

    def _again(self) -> None:
        self._refill = False
        self.on_incoming()

    def _to_host(self, octet: int) -> None:
        if self.transport.room:
            self.transport.write(bytes((octet,)))
            self.transport.flush()
        else:
            self.lost_octets += 1

    def events(self) -> list[Event]:
        """Begin and end of each outage of the line."""
        assert self._scheduler is not None
        return self.outages.events(self._scheduler, "USB")

    def summary(self) -> dict[str, Any]:
        """Everything for a `summary.json`, under `hil.base_port`."""
        assert self.base is not None
        counts = self.base.statistics()
        usb = self.base.usb
        return {
            "url": self.url,
            "line": self.where,
            "address": self._config.base_station.address,
            "promiscuous": self._config.hil.base_promiscuous,
            "bridge": counts["bridge"],
            "radio": counts["network"],
            "uart": {
                "from_host_octets": usb.to_mote_octets,
                "to_host_octets": usb.to_host_octets,
                "lost_octets": self.lost_octets,
                "overruns": counts["uart_overruns"],
                "garbled": counts["uart_garbled"],
            },
            "outages": self.outages.summary(),
        }

    def close(self) -> None:
        """Give the line back."""
        self.transport.close()


def words(told: dict[str, Any]) -> list[str]:
    """Lines on the port, for the terminal; `told` is a `summary`."""
    bridge, uart = told["bridge"], told["uart"]
    return [
        f"  {'base station':<14}address {told['address']}, USB port at {told['line']}",
        (
            f"  {'host to radio':<14}{bridge['from_host']} packets, {bridge['on_air']} sent, "
            f"{bridge['unanswered']} not acknowledged on the air, {bridge['refused']} refused, "
            f"{bridge['repeated']} repeated, {bridge['damaged']} damaged"
        ),
        (
            f"  {'radio to host':<14}{bridge['from_radio']} messages, {bridge['to_host']} sent up, "
            f"{bridge['dropped']} dropped, {uart['lost_octets']} octets not read"
        ),
    ]
