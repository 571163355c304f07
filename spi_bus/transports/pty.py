"""A pseudo-terminal: to whoever opens its path, a serial port.

Our side holds the far side open too. Without that the kernel reports a hang-up from the moment the
last reader of the path closes it, and forgets its settings: a terminal program that is closed and
opened again would end the session. The price is that nobody at the far end looks the same as
somebody who says nothing, as on three wires without modem lines; the link notices silence by
itself. What nobody reads fills the terminal's 4 KiB and then `room` is 0: that is the
back-pressure.

The far side starts in raw mode without echo, so that a program that only opens and reads gets our
bytes and not its own.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from spi_bus.errors import PortBusyError, PortNotFoundError, PortPermissionError, TransportError
from spi_bus.transports.base import OpenContext
from spi_bus.transports.descriptor import DescriptorTransport
from spi_bus.transports.urls import Url, take

__all__ = ["PtyTransport", "open_url"]


class PtyTransport(DescriptorTransport):
    """The controlling side of a new pseudo-terminal.

    Args:
        link: a symbolic link to make beside the path that the system chooses; one to a
            pseudo-terminal that is gone is replaced, anything else is left alone.

    Raises:
        PortBusyError: `link` is there: another program's, or something else.
        PortNotFoundError, PortPermissionError: `link` cannot be made.
        TransportError: the system has no pseudo-terminals, or none left.

    """

    def __init__(self, link: str | None = None) -> None:
        try:
            import pty
            import tty

            ours, theirs = pty.openpty()
        except (ImportError, OSError) as error:
            raise TransportError(
                f"pty: this system gives no pseudo-terminal ({error}): use socket:// or a "
                "serial port instead"
            ) from error
        self.path = os.ttyname(theirs)
        """What the other side opens."""
        self.link = Path(link) if link else None
        self._theirs = theirs
        try:
            tty.setraw(theirs)
            os.set_blocking(ours, False)
            if self.link is not None:
                _make_link(self.link, self.path)
        except BaseException:
            os.close(ours)
            os.close(theirs)
            raise
        where = f"{link} -> {self.path}" if link else self.path
        super().__init__(ours, f"pty {where}", close=self._close_both)
        self._ours = ours

    def _close_both(self) -> None:
        if self.link is not None:
            with suppress(OSError):
                if os.readlink(self.link) == self.path:
                    self.link.unlink()
        os.close(self._ours)
        os.close(self._theirs)


def open_url(url: Url, context: OpenContext) -> PtyTransport:
    """Open `pty:` or `pty:?link=PATH`."""
    del context
    return PtyTransport(take(url, {"link": str}).get("link"))


def _make_link(link: Path, target: str) -> None:
    what = "and no link to a pty"
    try:
        old = os.readlink(link) if link.is_symlink() else ""
        if old.startswith(os.path.dirname(target) + "/"):
            if old == target or not os.path.exists(old):
                link.unlink()
            else:
                what = f"and leads to {old}, which a program has open"
        link.symlink_to(target)
    except FileExistsError as error:
        raise PortBusyError(f"pty: {link} is there already {what}: name another path") from error
    except FileNotFoundError as error:
        raise PortNotFoundError(
            f"pty: no folder {link.parent} for the link: make it, or name another path"
        ) from error
    except OSError as error:
        raise PortPermissionError(
            f"pty: the link {link} cannot be made ({error.strerror}): name another path"
        ) from error
