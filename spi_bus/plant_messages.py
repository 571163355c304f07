"""The messages of a plant in the loop: raw sensor signals to a navigation board, pulses back.

The host, where the plant swims, is the link's master, the real navigation board its slave. Nothing
here is an SI reading of an instrument: counts of a converter, contents of registers, characters of
a UART, widths of pulses, as the chips' drivers see them. The link is that of the boards (frames,
CRC, sequence, acknowledgement); numbers differ from `spi_bus.messages`, so that a line plugged into
the wrong port says so.

Two messages are the streams of their sides (`Link.send_newest`): samples and pulses come at a fixed
rate, and an old one is worth nothing once there is a newer one. Sent again it would take the time
of its successors, so a lost one is only counted, by the numbers that they carry. All others change
a state or are a piece of a text, so they are acknowledged and sent again until they arrive: what is
written into registers, characters of the GPS, greetings. `docs/plant-in-the-loop.md` has the order
of events.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Any, Final

from spi_bus.layout import U8, U16, U32, U48, Field, Layout, MessageRow, MessageTable
from spi_bus.messages import MASTER, SLAVE

__all__ = [
    "ADC_INPUTS",
    "NMEA_MOST",
    "PLANT_MESSAGES",
    "PLANT_VERSION",
    "STREAMED",
    "BoardGreeting",
    "BoardStatus",
    "GpsPulse",
    "HostGreeting",
    "NmeaCharacters",
    "PlantTable",
    "RegisterWrite",
    "SampleStatus",
    "SensorSample",
    "ServoPulse",
]


class PlantTable(IntEnum):
    """What both sides have to have in common."""

    VERSION = 1
    """Of this table. A layout that changes gets a new number; both greetings carry it."""


PLANT_VERSION: Final = int(PlantTable.VERSION)
ADC_INPUTS: Final = 16
"""AN0 to AN15 of a dsPIC30F6014A."""
NMEA_MOST: Final = 16
"""Characters in one message: 33 ms at 4800 baud."""


class SampleStatus(IntFlag):
    """Bits of `SensorSample.status`."""

    SUPPLY_ON = 0x01
    """The pack has voltage: without it the real chips would not answer."""
    ACCELEROMETER_NEW = 0x02
    """The accelerometer's registers were filled since the sample before."""
    MAGNETOMETER_NEW = 0x04
    """The magnetometer's registers were filled since the sample before."""
    LATE = 0x08
    """The host took it later than half a period after its time."""


@dataclass(frozen=True, slots=True)
class HostGreeting:
    """Answers a `BoardGreeting`: samples come from now on, one every `period_us`.

    A board that has had none for `stale_after_us` is to treat its instruments as gone.
    """

    version: int
    period_us: int
    stale_after_us: int


@dataclass(frozen=True, slots=True)
class SensorSample:
    """All raw inputs of the board at one instant: converter counts and register contents.

    Registers are those of the LSM303DLH, by their names in the data sheet, with what the part would
    answer there. Inputs that the host does not drive are None.
    """

    number: int
    host_time_us: int
    status: int
    an0: int | None
    an1: int | None
    an2: int | None
    an3: int | None
    an4: int | None
    an5: int | None
    an6: int | None
    an7: int | None
    an8: int | None
    an9: int | None
    an10: int | None
    an11: int | None
    an12: int | None
    an13: int | None
    an14: int | None
    an15: int | None
    status_reg_a: int
    out_x_l_a: int
    out_x_h_a: int
    out_y_l_a: int
    out_y_h_a: int
    out_z_l_a: int
    out_z_h_a: int
    out_x_h_m: int
    out_x_l_m: int
    out_y_h_m: int
    out_y_l_m: int
    out_z_h_m: int
    out_z_l_m: int
    sr_reg_m: int

    @classmethod
    def of(
        cls,
        number: int,
        host_time_us: int,
        status: int,
        counts: Mapping[int, int],
        accelerometer: bytes,
        magnetometer: bytes,
    ) -> "SensorSample":
        """Make one of counts by input number and of registers in the order of their addresses."""
        inputs = [counts.get(place) for place in range(ADC_INPUTS)]
        values: tuple[Any, ...] = (*inputs, *accelerometer, *magnetometer)
        return cls(number, host_time_us, status, *values)

    @property
    def counts(self) -> tuple[int | None, ...]:
        """Counts of AN0 to AN15."""
        return tuple([getattr(self, name) for name in AN_NAMES])

    @property
    def accelerometer(self) -> bytes:
        """STATUS_REG_A to OUT_Z_H_A, addresses 0x27 to 0x2D."""
        return bytes([getattr(self, name) for name in ACCELEROMETER_NAMES])

    @property
    def magnetometer(self) -> bytes:
        """OUT_X_H_M to SR_REG_M, addresses 0x03 to 0x09."""
        return bytes([getattr(self, name) for name in MAGNETOMETER_NAMES])


AN_NAMES: Final = tuple(f"an{number}" for number in range(ADC_INPUTS))
ACCELEROMETER_NAMES: Final = tuple(
    field.name for field in fields(SensorSample) if field.name.endswith("_a")
)
MAGNETOMETER_NAMES: Final = tuple(
    field.name for field in fields(SensorSample) if field.name.endswith("_m")
)


@dataclass(frozen=True, slots=True)
class NmeaCharacters:
    """Characters of the GPS receiver, ahead of their time.

    The first is complete at `due_us` of the host's clock, each further one ten bits of `baud`
    later. Unused characters are zero.
    """

    due_us: int
    baud: int
    count: int
    character_0: int
    character_1: int
    character_2: int
    character_3: int
    character_4: int
    character_5: int
    character_6: int
    character_7: int
    character_8: int
    character_9: int
    character_10: int
    character_11: int
    character_12: int
    character_13: int
    character_14: int
    character_15: int

    @classmethod
    def of(cls, due_us: int, baud: int, text: bytes) -> "NmeaCharacters":
        """Make one of at most `NMEA_MOST` characters."""
        return cls(due_us, baud, len(text), *text.ljust(NMEA_MOST, b"\0"))

    @property
    def text(self) -> bytes:
        """The characters."""
        return bytes([getattr(self, f"character_{place}") for place in range(self.count)])


@dataclass(frozen=True, slots=True)
class GpsPulse:
    """The measurement pulse of the GPS, announced a second ahead: it rises at `rise_us`."""

    rise_us: int
    width_us: int


@dataclass(frozen=True, slots=True)
class BoardGreeting:
    """What the board says first, after every start of either side.

    Then it repeats every register that it has written since its own start.
    """

    version: int
    most_rate_hz: int
    analog_inputs: int
    gps_fitted: bool


@dataclass(frozen=True, slots=True)
class ServoPulse:
    """A pulse of the servo output ended at `board_time_us` of the board's clock.

    `sample` is the newest sample that had come by then, `sample_age_us` how long before it had: the
    round trip without the board's own time follows.
    """

    number: int
    board_time_us: int
    width_s: float
    sample: int
    sample_age_us: int


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """The board's driver wrote a register of a chip on its I²C bus."""

    address: int
    sub_address: int
    value: int


@dataclass(frozen=True, slots=True)
class BoardStatus:
    """What the board counted since it started; once a second."""

    board_time_us: int
    samples: int
    missing: int
    repeated: int
    stalls: int
    pulses: int
    nmea_characters: int
    nmea_late: int


def _register(name: str) -> Field:
    return Field(name, U8, summary=f"{name.upper()} of the LSM303DLH")


_VERSION = Field("version", U8, summary="of this table")
_NUMBER = Field("number", U32, summary="counts from 1; wraps")
_BOARD_TIME = Field("board_time_us", U48, "µs", summary="board's clock since its reset")

HOST_GREETING: Final = Layout(
    HostGreeting,
    (
        _VERSION,
        Field("period_us", U32, "µs", minimum=1, summary="between samples"),
        Field("stale_after_us", U32, "µs", summary="after so long without one"),
    ),
)
SENSOR_SAMPLE: Final = Layout(
    SensorSample,
    (
        _NUMBER,
        Field("host_time_us", U48, "µs", summary="host's clock since the run began"),
        Field("status", U8, summary="bits of SampleStatus"),
        *(
            Field(name, U16, maximum=4095, optional=True, summary=f"counts of {name.upper()}")
            for name in AN_NAMES
        ),
        *(_register(name) for name in ACCELEROMETER_NAMES),
        *(_register(name) for name in MAGNETOMETER_NAMES),
    ),
)
NMEA_CHARACTERS: Final = Layout(
    NmeaCharacters,
    (
        Field("due_us", U48, "µs", summary="host's clock when the first is complete"),
        Field("baud", U16, "Bd", minimum=300, summary="of the receiver's line"),
        Field("count", U8, minimum=1, maximum=NMEA_MOST, summary="characters used"),
        *(
            Field(f"character_{place}", U8, summary="zero where unused")
            for place in range(NMEA_MOST)
        ),
    ),
)
GPS_PULSE: Final = Layout(
    GpsPulse,
    (
        Field("rise_us", U48, "µs", summary="host's clock"),
        Field("width_us", U32, "µs", summary="of the pulse"),
    ),
)
BOARD_GREETING: Final = Layout(
    BoardGreeting,
    (
        _VERSION,
        Field("most_rate_hz", U16, "Hz", minimum=1, summary="fastest samples that it takes"),
        Field("analog_inputs", U16, summary="bit n: it converts ANn"),
        Field("gps_fitted", U8, boolean=True, summary="it listens to a GPS receiver"),
    ),
)
SERVO_PULSE: Final = Layout(
    ServoPulse,
    (
        _NUMBER,
        _BOARD_TIME,
        Field("width_s", U16, "s", 10_000_000, summary="high time"),
        Field("sample", U32, summary="number of the newest sample; 0 before the first"),
        Field("sample_age_us", U32, "µs", summary="since that sample came"),
    ),
)
REGISTER_WRITE: Final = Layout(
    RegisterWrite,
    (
        Field("address", U8, maximum=0x7F, summary="of the chip, seven bits"),
        Field("sub_address", U8, summary="register, without an auto-increment bit"),
        Field("value", U8, summary="written"),
    ),
)
BOARD_STATUS: Final = Layout(
    BoardStatus,
    (
        _BOARD_TIME,
        Field("samples", U32, summary="taken"),
        Field("missing", U32, summary="numbers passed over"),
        Field("repeated", U32, summary="not newer than the one before, dropped"),
        Field("stalls", U16, summary="times without a sample for stale_after_us"),
        Field("pulses", U32, summary="of the servo output"),
        Field("nmea_characters", U32, summary="given to the UART"),
        Field("nmea_late", U32, summary="after their time, or too late for use"),
    ),
)

PLANT_MESSAGES: Final = MessageTable(
    (
        MessageRow(0x21, MASTER, HOST_GREETING, "rate of the samples"),
        MessageRow(0x22, MASTER, SENSOR_SAMPLE, "all raw inputs once; a stream"),
        MessageRow(0x23, MASTER, NMEA_CHARACTERS, "characters of the GPS"),
        MessageRow(0x24, MASTER, GPS_PULSE, "the GPS's pulse a second"),
        MessageRow(0xA1, SLAVE, BOARD_GREETING, "what the board is"),
        MessageRow(0xA2, SLAVE, SERVO_PULSE, "a pulse of the servo output; a stream"),
        MessageRow(0xA3, SLAVE, REGISTER_WRITE, "a register of a chip was written"),
        MessageRow(0xA4, SLAVE, BOARD_STATUS, "counters, once a second"),
    )
)
STREAMED: Final = frozenset({SensorSample, ServoPulse})
"""Messages that go in STREAM frames; all others go in DATA frames."""
