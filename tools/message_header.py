"""C headers of messages, made from the tables that the Python side encodes with.

Every message becomes a struct of raw integers (a small MCU has no floating point; scales stand
beside them as macros), an encoder, and a decoder that refuses what the Python decoder refuses.
All are `static inline` and move single bytes: alignment, padding, byte order and the width of int
do not matter, and what a firmware does not call costs it nothing.

`HEADERS` has a row for each table: the links', and the radio's as active messages. `python -m
tools.message_reference` writes the files; a test fails while one and its table differ.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from pathlib import Path
from textwrap import wrap
from typing import Final

from radio_802154 import messages as radio
from radio_802154 import routing_messages as routing
from spi_bus.layout import U48, Field, Layout, MessageRow, WireType, raw_bounds
from spi_bus.messages import LINK_MESSAGES, BoardEventCode
from spi_bus.plant_messages import PLANT_MESSAGES, PlantTable, SampleStatus

FOLDER: Final = Path(__file__).resolve().parent.parent / "spi_bus" / "firmware_c"

LINE: Final = 100  # characters


@dataclass(frozen=True, slots=True)
class Header:
    """A header: a table of messages, and what is particular about their bytes.

    Attributes:
        file: its name.
        prefix: of all names in it, with its underscore.
        rows: the messages.
        source: where the table stands.
        about: what a user has to know, lines of a comment.
        numbered: the number is the payload's first byte; else it travels beside it.
        codes: enumerations that values of the messages are of, with a line on each.
        entries: what may follow the fields of a message, again and again.

    """

    file: str
    prefix: str
    rows: tuple[MessageRow, ...]
    source: str
    about: str
    numbered: bool
    codes: tuple[tuple[str, str, type[IntEnum | IntFlag]], ...]
    entries: tuple[MessageRow, ...] = ()

    @property
    def path(self) -> Path:
        """Where it is kept."""
        return FOLDER / self.file

    @property
    def first(self) -> int:
        """Where in the payload a message's fields begin."""
        return 1 if self.numbered else 0

    @property
    def number(self) -> str:
        """What the macro with a message's number ends in."""
        return "ID" if self.numbered else "AM_TYPE"

    def name(self, row: MessageRow) -> str:
        """Name of a message's struct."""
        return self.prefix + c_name(row.layout.name)


HEADERS: Final = (
    Header(
        "fishbed_messages.h",
        "fishbed_",
        LINK_MESSAGES.rows,
        "spi_bus/messages.py",
        """\
 * Encoders write number and fields, the payload of fishbed_send, and return its length; 0 where a
 * member is outside its range, and then the buffer is untouched. Decoders return 1; 0 where the
 * payload is not this message as an encoder makes it, and then the struct is undefined.
""",
        True,
        (("Codes of a BoardEvent.", "BOARD_EVENT_CODE", BoardEventCode),),
    ),
    Header(
        "fishbed_radio_messages.h",
        "fishbed_radio_",
        radio.AM_MESSAGES,
        "radio_802154/messages.py",
        """\
 * They are payloads of active messages, big-endian: the number is the AM type and travels in the
 * packet's header. Encoders write the payload and return its length; 0 where a member is outside
 * its range, and then the buffer is untouched. Decoders return 1; 0 where the payload is not this
 * message as an encoder makes it, and then the struct is undefined.
""",
        False,
        (
            ("What became of a command.", "COMMAND_STATUS", radio.CommandStatus),
            ("Flags of a Telemetry.", "TELEMETRY_FLAG", radio.TelemetryFlag),
        ),
    ),
    Header(
        "fishbed_routing_messages.h",
        "fishbed_routing_",
        routing.ROUTING_MESSAGES,
        "radio_802154/routing_messages.py",
        """\
 * They are active messages of the network layer (docs/network.md), big-endian: the number is the AM
 * type. Behind the fields of some follow entries, or the application's octets, up to 28 octets in
 * all: ..._TAIL says how long one is. Encoders write the fields and return their length; 0 where a
 * member is outside its range, and then the buffer is untouched. Decoders return 1; 0 where the
 * payload is not this message as an encoder makes it, with a whole number of entries behind, and
 * then the struct is undefined. An entry has no number, and a coder of its own.
""",
        False,
        (("Flags of a Beacon.", "BEACON_FLAG", routing.BeaconFlag),),
        routing.ROUTING_ENTRIES,
    ),
    Header(
        "fishbed_plant_messages.h",
        "fishbed_plant_",
        PLANT_MESSAGES.rows,
        "spi_bus/plant_messages.py",
        """\
 * They go over a link of their own, to the host of a plant in the loop: sensor_sample comes as
 * FISHBED_EVENT_STREAM and servo_pulse goes by fishbed_send_newest; all others are messages.
 * Encoders write number and fields and return the length; 0 where a member is outside its range,
 * and then the buffer is untouched. Decoders return 1; 0 where the payload is not this message as
 * an encoder makes it, and then the struct is undefined.
""",
        True,
        (
            ("The table itself.", "TABLE", PlantTable),
            ("Bits of a sample's status.", "SAMPLE_STATUS", SampleStatus),
        ),
    ),
)
"""A header for firmware for each table."""


def c_name(name: str) -> str:
    """TailBeat → tail_beat."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def member(field: Field) -> str:
    """Name of a field in its struct."""
    return field.name if field.lsb_per_unit is None else f"{field.name}_raw"


def c_type(wire: WireType) -> str:
    """The smallest type of stdint.h that holds a wire type."""
    return f"{'' if wire.signed else 'u'}int{64 if wire is U48 else 8 * wire.size}_t"


def text(made: Header) -> str:
    """Return the text of a header."""
    guard = f"{made.file.upper().replace('.', '_')}"
    parts = [
        f"""\
/* Messages with their layouts. Made by python -m tools.message_reference from the table in
 * {made.source}: change that and not this file. docs/messages.md has them in words.
 *
 * Members that end in _raw hold scaled integers: value = raw / ..._LSB_PER_UNIT. A message with
 * optional members has `valid`, a mask of ..._HAS_... bits; a member without its bit is no value.
 *
{made.about} */
#ifndef {guard}
#define {guard}

#include "fishbed_bytes.h"

#include <stdint.h>
"""
    ]
    largest = max(
        radio.TOSH_DATA_LENGTH if row.tail else made.first + row.layout.size for row in made.rows
    )
    sizes = "; FISHBED_MAX_PAYLOAD of fishbed_link.h must hold it" if made.numbered else ""
    parts.append(
        f"/* Longest payload of the table{sizes}. */\n"
        f"#define {made.prefix.upper()}LARGEST_MESSAGE {largest}\n"
    )
    parts += [_message(made, row) for row in (*made.rows, *made.entries)]
    parts += [_codes(title, made.prefix.upper() + name, codes) for title, name, codes in made.codes]
    for sender in dict.fromkeys(row.sender for row in made.rows):
        rows = [row for row in made.rows if row.sender == sender]
        parts.append(_validator(made, sender, rows))
    whole = "\n".join([*parts, "#endif\n"])
    return "".join(_wrapped(line) + "\n" for line in whole.splitlines())


def _wrapped(line: str) -> str:
    if len(line) <= LINE:
        return line
    indent = " " * (len(line) - len(line.lstrip()) + 8)
    return "\n".join(
        wrap(line, LINE, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    )


def _comment(text: str) -> str:
    return f"/* {text} */"


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(value)


def _literal(value: int, wire: WireType) -> str:
    """An integer constant of the type that it is compared with, on any width of int."""
    if -0x7FFF <= value <= 0x7FFF:
        return str(value) if value >= 0 else f"({value})"
    bits = 64 if wire.size > 4 else 32 if wire.size > 2 else 16
    sign = "" if wire.signed else "U"
    if wire.signed and value == wire.minimum:
        return f"(-{sign}INT{bits}_C({-value - 1}) - 1)"
    return f"({sign}INT{bits}_C({value}))" if value < 0 else f"{sign}INT{bits}_C({value})"


def _message(made: Header, row: MessageRow) -> str:
    layout: Layout[object] = row.layout
    name = made.name(row)
    upper = name.upper()
    lines = [_comment(f"{layout.name}, from the {row.sender}: {row.summary}.")]
    if row not in made.entries:
        lines.append(f"#define {upper}_{made.number} 0x{row.kind:02X}")
    lines.append(f"#define {upper}_BYTES {made.first + layout.size}")
    if row.tail:
        lines.append(f"#define {upper}_TAIL {row.tail}")
    bit = 0
    for field in layout.rows:
        macro = f"{upper}_{field.name.upper()}"
        if field.lsb_per_unit is not None:
            lines.append(f"#define {macro}_LSB_PER_UNIT {_number(field.lsb_per_unit)}")
        low, high = raw_bounds(field)
        if (low, high) != (field.wire.minimum, field.wire.maximum):
            lines.append(f"#define {macro}_MIN {_literal(low, field.wire)}")
            lines.append(f"#define {macro}_MAX {_literal(high, field.wire)}")
        if field.optional:
            lines.append(f"#define {upper}_HAS_{field.name.upper()} {_bit(bit)}")
            bit += 1
    lines += ["", "typedef struct {"]
    if layout.mask is not None:
        lines.append(f"    {c_type(layout.mask)} valid;")
    for field in layout.rows:
        about = "" if field.unit == "1" else f"{field.unit}; "
        lines.append(f"    {c_type(field.wire)} {member(field)}; /* {about}{field.summary} */")
    lines += [f"}} {name};", ""]
    lines += _encoder(made, row)
    lines += _decoder(made, row)
    return "\n".join(lines)


def _bit(number: int) -> str:
    return f"0x{1 << number:04X}u" if number < 16 else f"UINT32_C(0x{1 << number:08X})"


def _has(upper: str, field: Field) -> str:
    return f"message->valid & {upper}_HAS_{field.name.upper()}"


def _refusals(layout: Layout[object], upper: str) -> list[str]:
    """Conditions under which neither side takes the values."""
    found = []
    optional = sum(field.optional for field in layout.rows)
    if layout.mask is not None and optional < 8 * layout.mask.size:
        mask = (1 << optional) - 1
        found.append(f"message->valid > {_literal(mask, layout.mask)}")
    for field in layout.rows:
        low, high = raw_bounds(field)
        value = f"message->{member(field)}"
        outside = []
        if low != field.wire.minimum:
            outside.append(f"{value} < {upper}_{field.name.upper()}_MIN")
        if field.wire is U48 and high == U48.maximum:
            outside.append(f"{value} > {_literal(high, U48)}")
        elif high != field.wire.maximum:
            outside.append(f"{value} > {upper}_{field.name.upper()}_MAX")
        if outside and field.optional:
            found.append(f"(({_has(upper, field)}) && ({' || '.join(outside)}))")
        else:
            found += outside
    return found


def _refuse(conditions: list[str]) -> list[str]:
    if not conditions:
        return []
    return [f"    if ({' || '.join(conditions)}) {{", "        return 0;",
            "    }"]  # fmt: skip


def _signature(function: str, *arguments: str) -> list[str]:
    start = f"static inline uint8_t {function}("
    lines = [start]
    if any(len(start) + len(argument) >= LINE for argument in arguments):
        start = " " * 8
        lines.append(start)
    for argument in arguments:
        if len(lines[-1]) + len(argument) + 3 > LINE:
            lines[-1] = lines[-1].rstrip()
            lines.append(" " * len(start))
        lines[-1] += f"{argument}, "
    lines[-1] = lines[-1].removesuffix(", ") + ")"
    return [*lines, "{"]


def _function(made: Header, verb: str, row: MessageRow) -> str:
    return f"{made.prefix}{verb}_{c_name(row.layout.name)}"


def _encoder(made: Header, row: MessageRow) -> list[str]:
    name, upper = made.name(row), made.name(row).upper()
    arguments = (f"const {name} *message", "uint8_t *payload")
    lines = [
        *_signature(_function(made, "encode", row), *arguments),
        *_refuse(_refusals(row.layout, upper)),
    ]
    if made.numbered:
        lines.append(f"    payload[0] = {upper}_ID;")
    order = row.layout.byte_order
    for offset, item in row.layout.offsets():
        at = made.first + offset
        if isinstance(item, WireType):
            lines.append(_put(item, at, "message->valid", order))
            continue
        value = f"message->{member(item)}"
        if item.optional:
            value = f"{_has(upper, item)} ? {value} : 0"
        lines.append(_put(item.wire, at, value, order))
    return [*lines, f"    return {upper}_BYTES;", "}", ""]


_SUFFIX: Final[dict[str, str]] = {"little": "", "big": "_be"}


def _put(wire: WireType, at: int, value: str, order: str) -> str:
    bits = 8 * wire.size
    if wire.signed or "?" in value:  # signed to unsigned, or int's promotion: said aloud
        value = f"(uint{bits}_t)({value})"
    if wire.size == 1:
        return f"    payload[{at}] = {value};"
    function = f"fishbed_put{_SUFFIX[order]}"
    if wire.size in (2, 4):
        return f"    {function}_u{bits}(payload + {at}, {value});"
    return f"    {function}(payload + {at}, {value}, {wire.size});"


def _get(wire: WireType, at: int, order: str) -> str:
    bits = 8 * wire.size
    function = f"fishbed_get{_SUFFIX[order]}"
    if wire.size == 1:
        value = f"payload[{at}]"
    elif wire.size in (2, 4):
        value = f"{function}_u{bits}(payload + {at})"
    else:
        value = f"{function}(payload + {at}, {wire.size})"
    return f"fishbed_signed_{bits}({value})" if wire.signed else value


def _decoder(made: Header, row: MessageRow) -> list[str]:
    name, upper = made.name(row), made.name(row).upper()
    arguments = (f"{name} *message", "const uint8_t *payload", "uint8_t length")
    number = f" || payload[0] != {upper}_ID" if made.numbered else ""
    relation = "<" if row.tail else "!="
    lines = [
        *_signature(_function(made, "decode", row), *arguments),
        *_refuse([f"length {relation} {upper}_BYTES{number}"]),
    ]
    if row.tail > 1:
        lines += _refuse([f"(length - {upper}_BYTES) % {upper}_TAIL != 0"])
    order = row.layout.byte_order
    for offset, item in row.layout.offsets():
        target = "valid" if isinstance(item, WireType) else member(item)
        wire = item if isinstance(item, WireType) else item.wire
        lines.append(f"    message->{target} = {_get(wire, made.first + offset, order)};")
    refused = _refusals(row.layout, upper) + [
        f"(!({_has(upper, field)}) && message->{member(field)} != 0)"
        for field in row.layout.rows
        if field.optional
    ]
    return [*lines, *_refuse(refused), "    return 1;", "}", ""]


def _codes(title: str, prefix: str, codes: type[IntEnum | IntFlag]) -> str:
    return "\n".join(
        [_comment(title), *(f"#define {prefix}_{code.name} {code.value}" for code in codes), ""]
    )


def _validator(made: Header, sender: str, rows: Iterable[MessageRow]) -> str:
    """A function that says whether a payload is a message that one side sends."""
    kind = ": a fishbed_validator" if made.numbered else ""
    beside = () if made.numbered else ("uint8_t am_type",)
    lines = [
        _comment(f"Whether a payload is a message that the {sender} sends{kind}."),
        *_signature(
            f"{made.prefix}from_{sender}", *beside, "const uint8_t *payload", "uint8_t length"
        ),
    ]
    if made.numbered:
        lines += ["    if (length == 0) {", "        return 0;", "    }"]
    lines.append(f"    switch ({'payload[0]' if made.numbered else 'am_type'}) {{")
    for row in rows:
        name = made.name(row)
        lines += [
            f"    case {name.upper()}_{made.number}: {{",
            f"        {name} message;",
            f"        return {_function(made, 'decode', row)}(&message, payload, length);",
            "    }",
        ]
    return "\n".join([*lines, "    default:", "        return 0;", "    }", "}", ""])
