"""The stream of a link: what comes at a fixed rate and is worth nothing once there is newer.

Its newest message waits here until the line takes it, and goes once; there is nothing to number, to
acknowledge or to time. Where messages wait as well the two take turns, so that neither starves.
"""

from spi_bus.link_types import Statistics

__all__ = ["Stream"]


class Stream:
    """The newest payload of our stream, while it waits.

    Args:
        statistics: the link's counters.

    """

    __slots__ = ("_last", "_statistics", "newest")

    def __init__(self, statistics: Statistics) -> None:
        self.newest = b""
        self._statistics = statistics
        self._last = False  # the next turn is a message's, where one waits

    def put(self, payload: bytes) -> None:
        """Take a payload in the place of one that still waits."""
        self.drop()
        self.newest = payload

    def drop(self) -> None:
        """Forget what waits: it would come too late, or to somebody else."""
        if self.newest:
            self.newest = b""
            self._statistics.replaced += 1

    def take(self, *, sendable: bool) -> bytes:
        """Return what goes now; b"" where nothing waits or it is a message's turn."""
        if not self.newest or (self._last and sendable):
            self._last = False
            return b""
        payload, self.newest = self.newest, b""
        self._last = True
        self._statistics.streamed += 1
        return payload
