"""What the firmware offers to an application, and what an application is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from firmware_model.cpu import Cpu
from procboard.alarms import Alarms
from procboard.drivers.uart import Uart
from procboard.link import LinkController
from procboard.network import Network, SendStatus
from procboard.routing.controller import Routing
from procboard.storage_controller import StorageController
from radio_802154.messages import CommandReply


def _nothing(*_arguments: object) -> None:
    """Stand in where nobody listens."""


@dataclass(slots=True)
class Hooks:
    """What a laboratory may hear of the firmware's doings; none of it exists on a real mote."""

    booted: Callable[[int], None] = _nothing
    """(boot number): everything is up."""
    sample: Callable[[object, bytes], None] = _nothing
    """(message, its bytes): a message came over the link."""
    appended: Callable[[int, bytes], None] = _nothing
    """(record number, payload): a record waits in RAM to be stored."""
    stored: Callable[[int], None] = _nothing
    """(record number): all records up to this one are stored."""
    sent: Callable[[int, object, SendStatus], None] = _nothing
    """(destination, message, outcome): a radio message is done with."""
    received: Callable[[int, object], None] = _nothing
    """(source, message): a radio message came."""
    command: Callable[[CommandReply], None] = _nothing
    """(reply): a command was answered."""
    tail_beat: Callable[[object], None] = _nothing
    """(TailBeat): sent to the navigation board, refreshments included."""
    control: Callable[[float, float], None] = _nothing
    """(heading error, bias) in rad: a step of a controller that steers."""
    tracking: Callable[..., None] = _nothing
    """(words, numbers): what target tracking has to say, see `ProcBoard`."""


@dataclass(slots=True)
class Services:
    """Controllers of a running board. A base station has neither link nor storage of its own."""

    cpu: Cpu
    alarms: Alarms
    network: Network
    boot: int
    hooks: Hooks = field(default_factory=Hooks)
    link: LinkController | None = None
    storage: StorageController | None = None
    usb: Uart | None = None
    """USART1 as a UART, which leads to USB; the link of a robot needs the same USART."""
    routing: Routing | None = None
    """The network layer; an application registers for its events when it starts."""


class Application(Protocol):
    """The head level: registers handlers and spawns tasks. Started anew at every boot."""

    def start(self, services: Services) -> None:
        """Begin; nothing of a former boot may be left."""
