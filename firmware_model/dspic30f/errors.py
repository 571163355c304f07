"""What firmware can get wrong with the peripherals of a dsPIC30F."""

from __future__ import annotations

from firmware_model.errors import EmulationError


class UnsupportedModeError(EmulationError, NotImplementedError):
    """Firmware chose a mode of a peripheral that this model leaves out."""


class LimitError(EmulationError, ValueError):
    """Firmware asked a peripheral for what its data sheet forbids."""
