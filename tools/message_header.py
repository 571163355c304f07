"""The C headers of the links' messages, made from the tables that the Python side encodes with.

Every message becomes a struct of raw integers (a small MCU has no floating point; scales stand
beside them as macros), an encoder, and a decoder that refuses what the Python decoder refuses.
All are `static inline` and move single bytes: alignment, padding, byte order and the width of int
do not matter, and what a firmware does not call costs it nothing.

`python -m tools.message_reference` writes the files; tests fail while they and the tables differ.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import IntEnum, IntFlag
from pathlib import Path
from textwrap import wrap

from spi_bus.layout import U48, Field, Layout, MessageRow, MessageTable, WireType, raw_bounds
from spi_bus.messages import LINK_MESSAGES, MASTER, SLAVE, BoardEventCode
from spi_bus.plant_messages import PLANT_MESSAGES, PLANT_VERSION, SampleStatus

HEADER = Path(__file__).resolve().parent.parent / "spi_bus" / "firmware_c" / "fishbed_messages.h"
PLANT_HEADER = HEADER.with_name("fishbed_plant_messages.h")

LINE = 100  # characters

_TOP = """\
/* The messages between the boards. Made by python -m tools.message_reference from the table in
 * spi_bus/messages.py: change that and not this file. docs/messages.md has the layouts in words.
 *
 * Members that end in _raw hold scaled integers: value = raw / ..._LSB_PER_UNIT. A message with
 * optional members has `valid`, a mask of ..._HAS_... bits; a member without its bit is no value.
 *
 * Encoders write number and fields, the payload of fishbed_send, and return its length; 0 where a
 * member is outside its range, and then the buffer is untouched. Decoders return 1; 0 where the
 * payload is not this message as an encoder makes it, and then the struct is undefined.
 */
#ifndef FISHBED_MESSAGES_H
#define FISHBED_MESSAGES_H

#include <stdint.h>

/* Numbers on the wire, little-endian, whatever the machine's own order. */

static inline void fishbed_put(uint8_t *to, uint64_t value, uint8_t count)
{
    while (count--) {
        *to++ = (uint8_t)(value & 0xFFu);
        value >>= 8;
    }
}

static inline void fishbed_put_u16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)(value & 0xFFu);
    to[1] = (uint8_t)(value >> 8);
}

static inline void fishbed_put_u32(uint8_t *to, uint32_t value)
{
    fishbed_put_u16(to, (uint16_t)(value & 0xFFFFu));
    fishbed_put_u16(to + 2, (uint16_t)(value >> 16));
}

static inline uint64_t fishbed_get(const uint8_t *from, uint8_t count)
{
    uint64_t value = 0;

    while (count--) {
        value = (value << 8) | from[count];
    }
    return value;
}

static inline uint16_t fishbed_get_u16(const uint8_t *from)
{
    return (uint16_t)(from[0] | ((uint16_t)from[1] << 8));
}

static inline uint32_t fishbed_get_u32(const uint8_t *from)
{
    return fishbed_get_u16(from) | ((uint32_t)fishbed_get_u16(from + 2) << 16);
}

static inline int8_t fishbed_signed_8(uint8_t value)
{
    return (int8_t)(value & 0x80u ? -(int8_t)(0xFFu - value) - 1 : (int8_t)value);
}

static inline int16_t fishbed_signed_16(uint16_t value)
{
    return (int16_t)(value & 0x8000u ? -(int16_t)(0xFFFFu - value) - 1 : (int16_t)value);
}

static inline int32_t fishbed_signed_32(uint32_t value)
{
    return value & UINT32_C(0x80000000) ? -(int32_t)(UINT32_C(0xFFFFFFFF) - value) - 1
                                        : (int32_t)value;
}
"""


_PLANT_TOP = """\
/* The messages of a plant in the loop. Made by python -m tools.message_reference from the table in
 * spi_bus/plant_messages.py: change that and not this file. docs/messages.md has the layouts in
 * words, docs/plant-in-the-loop.md the order of events; members, encoders and decoders are as in
 * fishbed_messages.h.
 *
 * fishbed_sensor_sample and fishbed_servo_pulse are streams: the first comes as
 * FISHBED_EVENT_STREAM, the second goes by fishbed_send_newest. All others are messages.
 */
#ifndef FISHBED_PLANT_MESSAGES_H
#define FISHBED_PLANT_MESSAGES_H

#include "fishbed_messages.h"
"""


def c_name(name: str) -> str:
    """TailBeat → tail_beat."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def member(field: Field) -> str:
    """Name of a field in its struct."""
    return field.name if field.lsb_per_unit is None else f"{field.name}_raw"


def c_type(wire: WireType) -> str:
    """The smallest type of stdint.h that holds a wire type."""
    return f"{'' if wire.signed else 'u'}int{64 if wire is U48 else 8 * wire.size}_t"


def header(table: MessageTable = LINK_MESSAGES) -> str:
    """Return the text of the header of the link between the boards."""
    codes = _codes("Codes of a BoardEvent.", "FISHBED_BOARD_EVENT_CODE", BoardEventCode)
    return _header(_TOP, table, "", codes)


def plant_header() -> str:
    """Return the text of the header of a plant in the loop."""
    codes = _codes("Bits of a SensorSample's status.", "FISHBED_SAMPLE_STATUS", SampleStatus)
    version = f"#define FISHBED_PLANT_VERSION {PLANT_VERSION}\n"
    return _header(_PLANT_TOP, PLANT_MESSAGES, "plant_", f"{version}\n{codes}")


def _header(top: str, table: MessageTable, name: str, codes: str) -> str:
    parts = [top]
    largest = max(row.size for row in table.rows)
    parts.append(
        "/* Longest payload of the table; FISHBED_MAX_PAYLOAD of fishbed_link.h must hold it. */\n"
        f"#define FISHBED_LARGEST_{name.upper()}MESSAGE {largest}\n"
    )
    parts += [_message(row) for row in table.rows]
    parts.append(codes)
    for sender in (MASTER, SLAVE):
        rows = [row for row in table.rows if row.sender == sender]
        parts.append(_validator(sender, rows, name))
    text = "\n".join([*parts, "#endif\n"])
    return "".join(_wrapped(line) + "\n" for line in text.splitlines())


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


def _message(row: MessageRow) -> str:
    layout: Layout[object] = row.layout
    if layout.byte_order != "little":
        raise ValueError(f"{layout.name} is big-endian; the link's messages are little-endian")
    name = c_name(layout.name)
    upper = f"FISHBED_{name.upper()}"
    lines = [_comment(f"{layout.name}, from the {row.sender}: {row.summary}.")]
    lines += [f"#define {upper}_ID 0x{row.kind:02X}", f"#define {upper}_BYTES {row.size}"]
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
    lines += [f"}} fishbed_{name};", ""]
    lines += _encoder(row, name, upper)
    lines += _decoder(row, name, upper)
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
    start = f"static inline uint8_t fishbed_{function}("
    lines = [start]
    for argument in arguments:
        if len(lines[-1]) + len(argument) + 3 > LINE:
            lines[-1] = lines[-1].rstrip()
            lines.append(" " * len(start))
        lines[-1] += f"{argument}, "
    lines[-1] = lines[-1].removesuffix(", ") + ")"
    return [*lines, "{"]


def _encoder(row: MessageRow, name: str, upper: str) -> list[str]:
    lines = [
        *_signature(f"encode_{name}", f"const fishbed_{name} *message", "uint8_t *payload"),
        *_refuse(_refusals(row.layout, upper)),
        f"    payload[0] = {upper}_ID;",
    ]
    for offset, item in row.layout.offsets():
        at = 1 + offset
        if isinstance(item, WireType):
            lines.append(_put(item, at, "message->valid"))
            continue
        value = f"message->{member(item)}"
        if item.optional:
            value = f"{_has(upper, item)} ? {value} : 0"
        lines.append(_put(item.wire, at, value))
    return [*lines, f"    return {upper}_BYTES;", "}", ""]


def _put(wire: WireType, at: int, value: str) -> str:
    bits = 8 * wire.size
    if wire.signed or "?" in value:  # signed to unsigned, or int's promotion: said aloud
        value = f"(uint{bits}_t)({value})"
    if wire.size == 1:
        return f"    payload[{at}] = {value};"
    if wire.size in (2, 4):
        return f"    fishbed_put_u{bits}(payload + {at}, {value});"
    return f"    fishbed_put(payload + {at}, {value}, {wire.size});"


def _get(wire: WireType, at: int) -> str:
    bits = 8 * wire.size
    if wire.size == 1:
        value = f"payload[{at}]"
    elif wire.size in (2, 4):
        value = f"fishbed_get_u{bits}(payload + {at})"
    else:
        value = f"fishbed_get(payload + {at}, {wire.size})"
    return f"fishbed_signed_{bits}({value})" if wire.signed else value


def _decoder(row: MessageRow, name: str, upper: str) -> list[str]:
    arguments = (f"fishbed_{name} *message", "const uint8_t *payload", "uint8_t length")
    lines = [
        *_signature(f"decode_{name}", *arguments),
        f"    if (length != {upper}_BYTES || payload[0] != {upper}_ID) {{",
        "        return 0;",
        "    }",
    ]
    for offset, item in row.layout.offsets():
        target = "valid" if isinstance(item, WireType) else member(item)
        wire = item if isinstance(item, WireType) else item.wire
        lines.append(f"    message->{target} = {_get(wire, 1 + offset)};")
    refused = _refusals(row.layout, upper) + [
        f"(!({_has(upper, field)}) && message->{member(field)} != 0)"
        for field in row.layout.rows
        if field.optional
    ]
    return [*lines, *_refuse(refused), "    return 1;", "}", ""]


def _codes(title: str, prefix: str, codes: type[IntEnum] | type[IntFlag]) -> str:
    return "\n".join(
        [_comment(title), *(f"#define {prefix}_{code.name} {code.value}" for code in codes), ""]
    )


def _validator(sender: str, rows: Iterable[MessageRow], name: str) -> str:
    arguments = "const uint8_t *payload, uint8_t length"
    lines = [
        _comment(f"Whether a payload is a message that the {sender} sends: a fishbed_validator."),
        f"static inline uint8_t fishbed_{name}from_{sender}({arguments})",
        "{",
        "    if (length == 0) {",
        "        return 0;",
        "    }",
        "    switch (payload[0]) {",
    ]
    for row in rows:
        kind = c_name(row.layout.name)
        lines += [
            f"    case FISHBED_{kind.upper()}_ID: {{",
            f"        fishbed_{kind} message;",
            f"        return fishbed_decode_{kind}(&message, payload, length);",
            "    }",
        ]
    return "\n".join([*lines, "    default:", "        return 0;", "    }", "}", ""])
