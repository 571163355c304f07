"""The table of commands: a command is one file here and one row below."""

from __future__ import annotations

import argparse
from typing import Protocol

from tools.commands import (
    board,
    decode,
    diagnose,
    doctor,
    hil,
    listing,
    practice,
    replay,
    reproduce,
    run,
    sweep,
    teleop,
)


class Command(Protocol):
    """What a module of this package offers."""

    NAME: str
    HELP: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments."""

    def run(self, args: argparse.Namespace) -> int:
        """Do it; returns the exit code."""


COMMANDS: tuple[Command, ...] = (
    run,
    replay,
    sweep,
    reproduce,
    diagnose,
    practice,
    board,
    hil,
    teleop,
    decode,
    listing,
    doctor,
)
