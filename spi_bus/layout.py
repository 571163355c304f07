"""Messages as tables: scaled integers on the wire, SI values in frozen dataclasses.

A `Field` row says how one attribute travels: wire type, least significant bits per unit, allowed
range, unit. A `Layout` is the rows of one dataclass; a `MessageTable` is the layouts of a link with
their numbers and who sends them. The rows are plain data, so a reference page or a C header can be
made from the very table that encodes (`Layout.offsets`).

Scales are given as LSB per unit, an integer wherever possible, as data sheets do: raw / 10000 is
the double nearest to the decimal fraction meant, raw * 1e-4 often is not.

An attribute may be None where its row says `optional`. Such a layout begins with a mask, one bit
per optional field in the order of the rows, least significant first; the field of a clear bit is
zero on the wire.

Encoding refuses what does not fit (FieldError), and never saturates: only the caller knows whether
a clipped value is still true. Decoding refuses what encoding cannot have produced (PayloadError).
"""

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from operator import attrgetter, index
from typing import Any, Final, Generic, Literal, TypeAlias, TypeVar

from spi_bus.errors import FieldError, LayoutError, PayloadError, UnknownMessageError

__all__ = [
    "I8",
    "I16",
    "I32",
    "TURN_LSB_PER_RAD",
    "U8",
    "U16",
    "U32",
    "U48",
    "U64",
    "Field",
    "Layout",
    "MessageRow",
    "MessageTable",
    "WireType",
    "raw_bounds",
]

M = TypeVar("M")

TURN_LSB_PER_RAD: Final = 32768 / math.pi
"""Binary angle: one turn is 2^16 LSB of 9.6e-5 rad, so the integer wraps where the angle does."""


@dataclass(frozen=True, slots=True)
class WireType:
    """An integer on the wire: its size, and how `struct` calls it."""

    name: str
    size: int
    signed: bool
    code: str

    @property
    def minimum(self) -> int:
        """Smallest raw value."""
        return -(1 << 8 * self.size - 1) if self.signed else 0

    @property
    def maximum(self) -> int:
        """Largest raw value."""
        return (1 << 8 * self.size - self.signed) - 1


U8: Final = WireType("u8", 1, False, "B")
I8: Final = WireType("i8", 1, True, "b")
U16: Final = WireType("u16", 2, False, "H")
I16: Final = WireType("i16", 2, True, "h")
U32: Final = WireType("u32", 4, False, "I")
I32: Final = WireType("i32", 4, True, "i")
U48: Final = WireType("u48", 6, False, "6s")  # struct has no such integer: bytes, converted here
U64: Final = WireType("u64", 8, False, "Q")


@dataclass(frozen=True, slots=True)
class Field:
    """One attribute of a message.

    Without `lsb_per_unit` the attribute is an integer (or a bool where `boolean`); with it a float,
    value = raw / lsb_per_unit. `minimum` and `maximum` bound the value, both included, and default
    to what the wire type holds. A field that `wraps` is an angle: its wire type holds exactly one
    turn, any finite value within the bounds is taken modulo that turn and comes back in [-π, π).
    """

    name: str
    wire: WireType
    unit: str = "1"
    lsb_per_unit: float | None = None
    minimum: float | None = None
    maximum: float | None = None
    optional: bool = False
    boolean: bool = False
    wraps: bool = False
    summary: str = ""

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value allowed."""
        scale = self.lsb_per_unit or 1
        low: float = self.wire.minimum
        high: float = 1 if self.boolean else self.wire.maximum
        if self.lsb_per_unit is not None:
            low, high = low / scale, high / scale
        if self.wraps:
            low, high = -WRAP_BOUND, WRAP_BOUND
        return (
            low if self.minimum is None else self.minimum,
            high if self.maximum is None else self.maximum,
        )


WRAP_BOUND: Final = 1e6
"""Largest angle (rad) that a wrapping field takes: beyond, a double resolves less than the wire."""

ByteOrder: TypeAlias = Literal["little", "big"]
Encoder: TypeAlias = Callable[[Any], int | bytes]
FieldDecoder: TypeAlias = Callable[[Any], int | float | bool]


def raw_bounds(row: Field) -> tuple[int, int]:
    """Smallest and largest integer on the wire."""
    if row.wraps:
        return row.wire.minimum, row.wire.maximum
    low, high = row.bounds
    if row.lsb_per_unit is None:
        return int(low), int(high)
    return round(low * row.lsb_per_unit), round(high * row.lsb_per_unit)


def _check(owner: str, row: Field) -> None:
    where = f"{owner}.{row.name}"
    low, high = row.bounds
    raw_low, raw_high = raw_bounds(row)
    if low > high or raw_low < row.wire.minimum or raw_high > row.wire.maximum:
        raise LayoutError(f"{where}: {low} to {high} {row.unit} do not fit {row.wire.name}")
    if row.lsb_per_unit is not None and not (
        math.isfinite(row.lsb_per_unit) and row.lsb_per_unit > 0
    ):
        raise LayoutError(f"{where}: {row.lsb_per_unit} LSB per {row.unit} is no scale")
    if row.boolean and row.lsb_per_unit is not None:
        raise LayoutError(f"{where}: a bool has no scale")
    if row.wraps and not (row.wire.signed and row.lsb_per_unit is not None):
        raise LayoutError(f"{where}: an angle that wraps is a scaled signed integer")


def _field_encoder(owner: str, row: Field, order: ByteOrder) -> Encoder:
    low, high = row.bounds
    scale = row.lsb_per_unit
    where = f"{owner}.{row.name}"
    allowed = f"{low:.6g} to {high:.6g} {row.unit}"

    def encode_integer(value: Any) -> int | bytes:
        try:
            raw: int = index(value)
        except TypeError:
            raise FieldError(f"{where} = {value!r} is no integer") from None
        if low <= raw <= high:
            return raw
        raise FieldError(f"{where} = {value!r} is outside {allowed}")

    def encode_scaled(value: Any) -> int | bytes:
        try:
            if low <= value <= high:  # False for NaN
                raw: int = round(value * scale)
                return raw
        except TypeError:
            raise FieldError(f"{where} = {value!r} is no number") from None
        raise FieldError(f"{where} = {value!r} is outside {allowed}")

    turn = 1 << 8 * row.wire.size
    half = turn >> 1

    def encode_angle(value: Any) -> int | bytes:
        return (encode_scaled(value) + half) % turn - half  # type: ignore[operator]  # an int

    narrow = encode_integer if scale is None else encode_angle if row.wraps else encode_scaled
    if row.wire is not U48:
        return narrow
    return lambda value: narrow(value).to_bytes(U48.size, order)  # type: ignore[union-attr]


def _field_decoder(owner: str, row: Field, order: ByteOrder) -> FieldDecoder | None:
    """Return what turns a raw value into the attribute; None where the raw value is it."""
    raw_low, raw_high = raw_bounds(row)
    scale = row.lsb_per_unit
    wide = row.wire is U48
    whole = (raw_low, raw_high) == (row.wire.minimum, row.wire.maximum)
    if whole and not wide:  # nothing to check: the many
        return None if scale is None else lambda raw: raw / scale

    def decode(raw: Any) -> int | float | bool:
        if wide:
            raw = int.from_bytes(raw, order)
        if not raw_low <= raw <= raw_high:
            raise PayloadError(f"{owner}.{row.name}: raw {raw} is outside {raw_low} to {raw_high}")
        if scale is None:
            return bool(raw) if row.boolean else int(raw)
        return float(raw / scale)

    return decode


class Layout(Generic[M]):
    """How one frozen dataclass travels: its rows, compiled to a `struct` and a function a field.

    Args:
        message: the dataclass; its attributes are the rows' names in the same order.
        rows: one `Field` for each attribute.
        byte_order: "little" (the link) or "big" (TinyOS nx_ structs).

    Raises:
        LayoutError: rows and dataclass differ, or a range does not fit its wire type.

    """

    __slots__ = (
        "_decoders", "_encoders", "_full_mask", "_get", "_struct", "byte_order", "mask",
        "message", "name", "rows", "size",
    )  # fmt: skip

    def __init__(
        self,
        message: type[M],
        rows: tuple[Field, ...],
        byte_order: ByteOrder = "little",
    ) -> None:
        self.message = message
        self.name = message.__name__
        self.rows = rows
        self.byte_order: ByteOrder = byte_order
        attributes = tuple(field.name for field in fields(message))  # type: ignore[arg-type]
        if attributes != tuple(row.name for row in rows) or not rows:
            raise LayoutError(f"{self.name}: rows and attributes {attributes} differ")
        for row in rows:
            _check(self.name, row)
        optional = sum(row.optional for row in rows)
        self.mask: WireType | None = None
        if optional:
            self.mask = U8 if optional <= 8 else U16 if optional <= 16 else U32
        codes = (self.mask.code if self.mask else "") + "".join(row.wire.code for row in rows)
        self._struct = struct.Struct(("<" if byte_order == "little" else ">") + codes)
        self.size = self._struct.size
        bits = iter(1 << number for number in range(optional))
        self._full_mask = (1 << optional) - 1
        self._encoders = tuple(
            (
                next(bits) if row.optional else 0,
                _field_encoder(self.name, row, byte_order),
                bytes(U48.size) if row.wire is U48 else 0,
            )
            for row in rows
        )
        self._decoders = tuple(_field_decoder(self.name, row, byte_order) for row in rows)
        self._get: Callable[[M], tuple[Any, ...]] = (
            attrgetter(*attributes)
            if len(attributes) > 1
            else lambda message: (getattr(message, attributes[0]),)
        )

    def encode(self, message: M) -> bytes:
        """Return the message's bytes, always `size` of them.

        Raises:
            FieldError: a value is out of its range, None where it must not be, or no number.

        """
        raws: list[int | bytes] = []
        mask = 0
        for value, (bit, encode, absent) in zip(self._get(message), self._encoders, strict=True):
            if bit:
                if value is None:
                    raws.append(absent)
                    continue
                mask |= bit
            raws.append(encode(value))
        if self.mask is None:
            return self._struct.pack(*raws)
        return self._struct.pack(mask, *raws)

    def decode(self, data: bytes, offset: int = 0) -> M:
        """Return the message in `data` from `offset` to the end.

        Raises:
            PayloadError: wrong length, or values that no encoder produces.

        """
        if len(data) - offset != self.size:
            raise PayloadError(f"{self.name} has {self.size} bytes, not {len(data) - offset}")
        raws: Sequence[Any] = self._struct.unpack_from(data, offset)
        if self.mask is not None:
            mask, *raws = raws
            if mask != self._full_mask:
                return self._decode_partial(mask, raws)
        return self.message(
            *[
                raw if decode is None else decode(raw)
                for raw, decode in zip(raws, self._decoders, strict=True)
            ]
        )

    def _decode_partial(self, mask: int, raws: Sequence[Any]) -> M:
        if mask & ~self._full_mask:
            raise PayloadError(f"{self.name}: mask 0x{mask:X} has bits that belong to no field")
        values: list[int | float | bool | None] = []
        for raw, decode, (bit, _, absent) in zip(raws, self._decoders, self._encoders, strict=True):
            if not bit or mask & bit:
                values.append(raw if decode is None else decode(raw))
            elif raw == absent:
                values.append(None)
            else:
                raise PayloadError(f"{self.name}: a field without its mask bit is not zero")
        return self.message(*values)

    def offsets(self) -> Iterator[tuple[int, Field | WireType]]:
        """Yield byte offset and row of everything on the wire, the mask (a `WireType`) first."""
        offset = 0
        if self.mask is not None:
            yield offset, self.mask
            offset += self.mask.size
        for row in self.rows:
            yield offset, row
            offset += row.wire.size


@dataclass(frozen=True, slots=True)
class MessageRow:
    """One message of a link: its number (first payload byte), who sends it, its layout."""

    kind: int
    sender: str
    layout: Layout[Any]
    summary: str
    tail: int = 0
    """Bytes of which a whole number may follow the layout: of an entry that repeats, or 1 for an
    application's; 0: nothing follows."""

    @property
    def size(self) -> int:
        """Payload bytes, with the number."""
        return 1 + self.layout.size


class MessageTable:
    """The messages of a link, found by class for sending and by number for receiving.

    Args:
        rows: the messages; their numbers and classes are unique.

    Raises:
        LayoutError: a number or a class occurs twice, or a number does not fit a byte.

    """

    __slots__ = ("_by_class", "_by_kind", "rows")

    def __init__(self, rows: tuple[MessageRow, ...]) -> None:
        self.rows = rows
        self._by_kind = {row.kind: row for row in rows}
        self._by_class = {
            row.layout.message: (bytes((row.kind,)), row.layout.encode, row.sender) for row in rows
        }
        if len(self._by_kind) < len(rows) or len(self._by_class) < len(rows):
            raise LayoutError("a message number or class occurs twice in the table")

    def encode(self, message: object, sender: str | None = None) -> bytes:
        """Return the payload: the number and the fields.

        Args:
            message: an instance of a class of the table.
            sender: where given, refuse what this side does not send.

        Raises:
            UnknownMessageError: no such message in the table, or not sent by `sender`.
            FieldError: a value does not fit.

        """
        entry = self._by_class.get(type(message))
        if entry is None:
            raise UnknownMessageError(f"{type(message).__name__} is no message of this link")
        kind, encode, by = entry
        if sender is not None and by != sender:
            raise UnknownMessageError(f"{type(message).__name__} is sent by the {by}, not by us")
        return kind + encode(message)

    def decode(self, payload: bytes, sender: str | None = None) -> object:
        """Return the message that a payload holds.

        Raises:
            PayloadError: an unknown number, one that `sender` does not send, or wrong contents.

        """
        row = self._by_kind.get(payload[0]) if payload else None
        if row is None or (sender is not None and row.sender != sender):
            number = payload[0] if payload else "absent"
            raise PayloadError(f"message number {number} is not one of the {sender or 'table'}'s")
        return row.layout.decode(payload, 1)
