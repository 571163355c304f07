"""One file decoded: its kind found, its protocol found or given, its items streamed.

Which protocol it is, is found by trial: the first octets go through every decoder, and the one
that makes sense of most of what it cuts out has it. These octets are kept, and decoded with the
rest. A checksum of eight bits makes sense of noise now and then, so that an XBee's frames have to
be one in four before they are believed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import BinaryIO, Final

from tools.decode.air import MacFrames
from tools.decode.files import LOOK, FileKind, detect, open_file
from tools.decode.items import Item, Octets, StreamDecoder, Tally, What
from tools.decode.link import LinkStream
from tools.decode.mote import TinyOsStream, XBeeStream
from tools.errors import UserError

TRIAL: Final = 1 << 15
"""Octets on which the protocols are tried."""
TRIAL_PARTS: Final = 20_000
"""Most parts, octets or findings, among them."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A row of the table: a decoder, what it is called, and how it is asked for."""

    protocol: str
    name: str
    make: Callable[[Tally], StreamDecoder]
    least_share: float = 0.0
    """Good frames of all, below which it is chance."""


VARIANTS: Final = (
    Variant("link", "link", LinkStream),
    Variant("tinyos", "tinyos", TinyOsStream),
    Variant("xbee", "xbee (AP 2)", lambda t: XBeeStream(t, escaped=True), 0.25),
    Variant("xbee", "xbee (AP 1)", lambda t: XBeeStream(t, escaped=False), 0.25),
    Variant("802.15.4", "802.15.4", MacFrames),
)
AUTO: Final = "auto"
PROTOCOLS: Final = (*dict.fromkeys(variant.protocol for variant in VARIANTS), AUTO)


class Session:
    """A file being decoded.

    Attributes:
        path: the file.
        kind: what it is.
        variant: the protocol.
        tally: the count so far.

    """

    def __init__(
        self,
        path: Path,
        kind: FileKind,
        variant: Variant,
        parts: Iterator[Octets | Item],
        file: BinaryIO,
    ) -> None:
        self.path = path
        self.kind = kind
        self.variant = variant
        self.tally = Tally()
        self._parts = parts
        self._file = file

    def nothing(self) -> str:
        """Say in a line that a protocol that was asked for is not there."""
        heard = self.tally.octets.total()
        frames = f", {self.tally.frames} damaged ones" if self.tally.frames else ""
        return (
            f"{self.path}: no intact frame of {self.variant.name} in {heard} octets{frames}: "
            f"is it another protocol (--protocol {AUTO} tries all), or another baud rate?"
        )

    def close(self) -> None:
        """Close the file; `items` does so at its end."""
        self._file.close()

    def items(self) -> Iterator[Item]:
        """Yield all items, in the file's order; closes the file."""
        with self._file:
            decoder = self.variant.make(self.tally)
            for part in self._parts:
                if isinstance(part, Octets):
                    self.tally.heard(part)
                    found = decoder.feed(part)
                else:
                    found = iter((part,))
                for item in found:
                    self.tally.count(item)
                    yield item
            yield from decoder.finish()


def open_session(path: Path, protocol: str) -> Session:
    """Open a file and find out what it is.

    Raises:
        UserError: it cannot be read, it is nothing that is read here, or no protocol fits.

    """
    file = open_file(path)
    try:
        return from_file(path, file, protocol)
    except OSError as error:
        file.close()
        raise UserError(f"{path} cannot be read: {error.strerror}") from None
    except BaseException:
        file.close()
        raise


def from_file(path: Path, file: BinaryIO, protocol: str) -> Session:
    """Find out what an open file is.

    Raises:
        UserError: it is nothing that is read here, or no protocol fits.

    """
    name = str(path)
    kind = detect(file.read(LOOK), name)
    if not file.seekable():
        raise UserError(f"{name} is a pipe: give it as a file")
    file.seek(0)
    parts = kind.read(file, name)
    if kind.whole_frames:
        if protocol not in (AUTO, "802.15.4"):
            raise UserError(f"{name} is a capture of 802.15.4, not of {protocol}")
        return Session(path, kind, VARIANTS[-1], parts, file)
    candidates = [v for v in VARIANTS if protocol in (AUTO, v.protocol)]
    if len(candidates) == 1:
        return Session(path, kind, candidates[0], parts, file)
    first: list[Octets | Item] = []
    octets = 0
    for part in parts:
        first.append(part)
        octets += len(part.data) if isinstance(part, Octets) else 0
        if octets >= TRIAL or len(first) >= TRIAL_PARTS:
            break
    variant = _best(candidates, first) or (None if protocol == AUTO else candidates[0])
    if variant is None:
        raise UserError(
            f"{name}: no frame of {', '.join(PROTOCOLS[:-1])} in its first {octets} octets; "
            f"if you know the protocol, say --protocol (wrong baud rate when it was recorded?)"
        )
    return Session(path, kind, variant, chain(first, parts), file)


def _best(candidates: list[Variant], parts: list[Octets | Item]) -> Variant | None:
    best: tuple[float, Variant] | None = None
    for variant in candidates:
        share = _share(variant, parts)
        if share > variant.least_share and (best is None or share > best[0]):
            best = share, variant
    return best[1] if best else None


def _share(variant: Variant, parts: list[Octets | Item]) -> float:
    """Good frames of all frames of a trial."""
    tally = Tally()
    decoder = variant.make(tally)
    errors = 0
    found = chain.from_iterable(decoder.feed(part) for part in parts if isinstance(part, Octets))
    for item in chain(found, decoder.finish()):
        tally.count(item)
        errors += item.what is What.ERROR
    return tally.good / (tally.good + errors) if tally.good else 0.0
