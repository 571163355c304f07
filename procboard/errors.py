"""Errors of the processing board: each says what the firmware or its user did wrong."""

from __future__ import annotations


class ProcBoardError(Exception):
    """Base of every error of this package."""


class ProcConfigError(ProcBoardError, ValueError):
    """A configuration that no board can have; the message says what is allowed."""


class RecordTooLongError(ProcBoardError, ValueError):
    """A record that does not fit a page of the flash."""


class LogFullError(ProcBoardError, RuntimeError):
    """The flash is full and its policy is to stop; nothing was stored or lost."""


class FlashFailureError(ProcBoardError, RuntimeError):
    """The flash does not answer, or does not keep what is programmed into it."""


class RadioFailureError(ProcBoardError, RuntimeError):
    """The radio chip does not answer as its datasheet says."""


class SurveyError(ProcBoardError, ValueError):
    """A survey that cannot be planned from what was given; the message says what is missing."""


class MessageTooLongError(ProcBoardError, ValueError):
    """A record or item that no message of the network layer holds."""
