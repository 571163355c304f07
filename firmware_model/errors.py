"""Errors of the emulation kernel: each says what the firmware or the wiring did wrong."""

from __future__ import annotations


class EmulationError(Exception):
    """Base of every error of the kernel."""


class SchedulingError(EmulationError, ValueError):
    """An event was asked for in the past."""


class RegisterError(EmulationError, LookupError):
    """Firmware touched an address or a name where there is no register."""


class FirmwareError(EmulationError, RuntimeError):
    """Firmware broke a rule of its CPU, such as waiting inside an interrupt handler."""


class WiringError(EmulationError, ValueError):
    """A board was put together in a way that the hardware does not allow."""
