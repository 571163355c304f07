"""Where link bytes leave the protocol: a table of what there is, loaded when it is wanted."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final

__all__ = ["TRANSPORTS", "TransportRow"]


@dataclass(frozen=True, slots=True)
class TransportRow:
    """One transport: its name, where it lives, and a line for the user."""

    name: str
    module: str
    factory: str
    description: str

    def load(self) -> Any:
        """Return the class, importing its module now."""
        return getattr(import_module(self.module), self.factory)


TRANSPORTS: Final = (
    TransportRow(
        "emulated",
        "spi_bus.transports.emulated",
        "SpiWires",
        "SCK, MOSI, MISO, chip select and data ready between two emulated boards, bit errors too",
    ),
)
