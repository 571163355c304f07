"""What goes wrong, and whose fault it is.

A user's mistake is a `UserError`: its text is one line that says where, what, and what to do; the
command line prints it and exits with 2. Everything else that is raised is a fault in this software
and keeps its full traceback, because that is what its reporter must send.
"""


class UserError(Exception):
    """The user's input or environment is at fault; `str()` is one line with the remedy."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


class ScenarioError(UserError, ValueError):
    """A scenario, or a `--set` on top of it, says something that cannot be."""


class RunFolderError(UserError, OSError):
    """A run folder cannot be written or read."""

    # OSError overrides __str__ for two arguments only; one argument prints as it is.


class MissingProgramError(UserError, RuntimeError):
    """Something that the command needs is not installed on this machine."""
