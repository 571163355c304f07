"""The base station's mote as a TinyOS BaseStation: a host at its USB port, radio at its antenna."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.trace import Trace
from procboard.applications.serial_bridge import RADIO_QUEUE, UART_QUEUE, SerialBridgeApp
from procboard.board import Mote, MoteHardware
from procboard.chips.ft232 import Ft232
from procboard.firmware import FirmwareConfig
from procboard.network import NetworkConfig, Received, SendStatus
from radio_802154.air import Air
from radio_802154.tinyos_serial import BAUD, AmMessage


class SerialBaseStation(Mote):
    """A TelosB with the serial bridge.

    Args: as `BaseStation`; `to_host` is called with each octet of the USB port, whose converter is
    `usb`, at the host's `baud`.

    Trace channels: NAME.boot; NAME.radio.sent: (destination, AM type, payload, outcome);
    NAME.radio.received: (source, AM type, payload).
    """

    def __init__(
        self,
        scheduler: Scheduler,
        trace: Trace,
        rail: Rail,
        air: Air,
        network: NetworkConfig,
        to_host: Callable[[int], None],
        name: str = "base",
        seed: int = 0,
        hardware: MoteHardware | None = None,
        baud: int = BAUD,
    ) -> None:
        self.app = SerialBridgeApp()
        config = FirmwareConfig(
            replace(network, queue_limit=RADIO_QUEUE), with_robot=False, usb_queue=UART_QUEUE
        )
        super().__init__(
            scheduler, trace, rail, air, config, self.app, name, seed, None,
            hardware or MoteHardware(),
        )  # fmt: skip
        self.usb = Ft232(scheduler, self.mote.mcu.usart1, baud, to_host)
        self.app.on_sent = self._on_sent
        self.app.on_heard = self._on_heard

    def _on_sent(self, message: AmMessage, status: SendStatus) -> None:
        self.sent_messages += status in (SendStatus.ACKNOWLEDGED, SendStatus.SENT)
        record = (message.destination, message.am_type, message.payload, status.value)
        self._radio_sent.record(self.scheduler.now, record)

    def _on_heard(self, received: Received) -> None:
        self.received_messages += 1
        record = (received.source, received.am_type, received.payload)
        self._radio_received.record(self.scheduler.now, record)

    def statistics(self) -> dict[str, Any]:
        """Return counters, for a summary."""
        services = self.services
        return {
            **self._mote_statistics(),
            "bridge": asdict(self.app.counts),
            "uart_overruns": services.usb.overruns if services and services.usb else 0,
            "uart_garbled": self.usb.garbled,
        }
