"""What boards tell each other in a survey: items of `procboard.routing.sharing`.

An item is its number and its fields, big-endian as the messages that carry it, 20 octets at most.
A sample's value and deviation have a resolution of 1e-4 in the field's unit, within ±214,748: finer
than any sensor on board and than what pictures of 256 greys need. Every board computes with the
value as it was shared, its sampler too, or boards would not decide alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from procboard.survey.rank import Cell
from spi_bus.layout import I8, I16, I32, U8, U16, U32, Field, Layout, MessageRow, MessageTable

ROBOT: Final = "robot"
RESOLUTION: Final = 1e-4
"""Of values and deviations, in the field's unit."""
_LSB: Final = 10_000


@dataclass(frozen=True, slots=True)
class Sample:
    """A cell was sampled: the mean of some readings, and where on the mean they were taken."""

    row: int
    column: int
    value: float
    deviation: float
    readings: int
    offset_x_m: float
    offset_y_m: float
    time_ms: int

    @property
    def cell(self) -> Cell:
        """Row and column."""
        return self.row, self.column


@dataclass(frozen=True, slots=True)
class Skip:
    """The sender did not reach a cell within its time; another is to try, if any is left.

    ``final``: none is, so the cell is given up.
    """

    row: int
    column: int
    final: bool

    @property
    def cell(self) -> Cell:
        """Row and column."""
        return self.row, self.column


@dataclass(frozen=True, slots=True)
class Gone:
    """Nothing came from a robot after its item ``last`` for long; or the sender cannot go on.

    A later item of that robot makes it one of the living again.
    """

    address: int
    last: int


@dataclass(frozen=True, slots=True)
class Present:
    """The sender lives. ``joined``: it begins to take part, or does so again, from this place."""

    x_m: float
    y_m: float
    joined: bool


@dataclass(frozen=True, slots=True)
class Done:
    """To the sender the field is known, from samples with this digest (`Knowledge.digest`)."""

    samples: int
    digest: int


SAMPLE: Final = Layout(
    Sample,
    (
        Field("row", U8, summary="of the cell, from 0"),
        Field("column", U8, summary="of the cell, from 0"),
        Field("value", I32, "field", _LSB, summary="mean of the readings"),
        Field("deviation", U32, "field", _LSB, RESOLUTION, summary="of the value's error"),
        Field("readings", U8, minimum=1, summary="how many; 255: or more"),
        Field("offset_x_m", I8, "m", 1000, summary="mean place of the readings less the centre"),
        Field("offset_y_m", I8, "m", 1000, summary="mean place of the readings less the centre"),
        Field("time_ms", U32, "ms", summary="of the boards' common clock, wraps"),
    ),
    "big",
)
SKIP: Final = Layout(
    Skip,
    (
        Field("row", U8, summary="of the cell"),
        Field("column", U8, summary="of the cell"),
        Field("final", U8, boolean=True, summary="nobody is left to try"),
    ),
    "big",
)
GONE: Final = Layout(
    Gone,
    (
        Field("address", U16, summary="who is silent; the sender's own: it cannot go on"),
        Field("last", U16, summary="number of its last item known"),
    ),
    "big",
)
PRESENT: Final = Layout(
    Present,
    (
        Field("x_m", I16, "m", 1000, summary="where the sender is"),
        Field("y_m", I16, "m", 1000, summary="where the sender is"),
        Field("joined", U8, boolean=True, summary="it begins from there"),
    ),
    "big",
)
DONE: Final = Layout(
    Done,
    (
        Field("samples", U16, summary="cells sampled"),
        Field("digest", U32, summary="of all samples, see knowledge.py"),
    ),
    "big",
)

SURVEY_ITEMS: Final = (
    MessageRow(0x01, ROBOT, SAMPLE, "a cell was sampled"),
    MessageRow(0x02, ROBOT, SKIP, "a cell was not reached"),
    MessageRow(0x03, ROBOT, GONE, "a robot is silent, or cannot go on"),
    MessageRow(0x04, ROBOT, PRESENT, "the sender lives"),
    MessageRow(0x05, ROBOT, DONE, "the field is known"),
)
ITEMS: Final = MessageTable(SURVEY_ITEMS)
"""Encodes and decodes; raises ``PayloadError`` for octets that no board sends."""

Item = Sample | Skip | Gone | Present | Done
