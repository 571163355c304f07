"""The `fishbed` command: one parser, one table of commands, one place where errors end.

Every command is a module of `tools.commands` with `NAME`, `HELP`, `add_arguments` and `run`. These
modules import nothing heavy at their top, so that `fishbed --help` costs little more than Python
itself; what a command needs is imported when it runs.
"""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from tools.commands.table import COMMANDS
from tools.errors import UserError

EXIT_USER = 2
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What writing ends with that no program can mend: no room on the disk, or no disk."""
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it


class _Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line, as all our complaints are."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message} (see: {self.prog} --help)")


class _Version(argparse.Action):
    """Looks the version up only when asked: reading package metadata costs start-up time."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from tools.version import version

        print(f"fishbed {version()}")
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """The whole command line, built from the table of commands."""
    parser = _Parser(
        prog="fishbed",
        description="Testbed for a two-board robotic fish: swim it, log it, talk to it. "
        "Begin with: fishbed run",
        epilog="exit codes: 0 done; 1 a check that you asked for failed; 2 input or environment "
        "at fault; 130 interrupted",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(metavar="COMMAND", dest="command", required=True)
    for command in COMMANDS:
        sub = commands.add_parser(command.NAME, help=command.HELP, description=command.HELP)
        command.add_arguments(sub)
        sub.set_defaults(run=command.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code of the contract (0, 1, 2, or 130 when interrupted)."""
    try:
        args = build_parser().parse_args(argv)
        code: int = args.run(args)
        sys.stdout.flush()
    except UserError as error:
        print(f"fishbed: {error}", file=sys.stderr)
        return EXIT_USER
    except KeyboardInterrupt:
        print("fishbed: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        _silence_stdout()  # the reader went away, as in `fishbed list | head`
        return 0
    except OSError as error:
        if error.errno not in FULL:
            raise
        _silence_stdout()
        print(f"fishbed: output cannot be written: {error.strerror}", file=sys.stderr)
        return EXIT_USER
    return code


def _silence_stdout() -> None:
    """Keep the interpreter's own flush at its end quiet about what cannot be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
