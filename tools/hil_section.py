"""`[hil]` of a scenario: who takes part from outside, and by which lines."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from tools.ranges import Fraction, Moment, Section


class XBeeRegisters(Section, frozen=True):
    """`[hil.xbee_registers]`: what is written in an emulated XBee, by the manual's two letters.

    API mode (0: none), baud rate (3: 9600, 7: 115200), MAC mode (0, 3: with a Digi header), first
    back-off exponent, guard time in ms. Channel, PAN and addresses are those of the scenario.
    """

    AP: Annotated[int, Meta(ge=0, le=2)] = 2
    BD: Annotated[int, Meta(ge=0, le=7)] = 3
    MM: Annotated[int, Meta(ge=0, le=3)] = 2
    RN: Annotated[int, Meta(ge=0, le=3)] = 0
    GT: Annotated[int, Meta(ge=2, le=3300)] = 1000


class Hil(Section, frozen=True):
    """`[hil]`: a real board in the place of an emulated one, by the URL of the line to it.

    Such a run keeps to real time. It ends by itself where `late` says "stop" and something was late
    by more than `late_bound_s`. `ping_period_s` is how often the round trip is measured.

    With `plant_for` there is the plant alone, `plant_rate_hz` raw samples a second for a real
    navigation board; with `plant` the emulated one (beside `proc`) has such samples for chips.

    `camera` is where an external tracker's poses come from, in the place of the emulated camera;
    `camera_clock` what its time stamps count (a clock of its own, or this machine's). `xbee` is the
    serial port of an emulated XBee module that stands in the place of the base station; at
    `xbee_restarts_s` its supply is away for half a second.

    `mote` is a real TinyOS BaseStation on USB, by which the emulated air meets the real one;
    `radio_nodes` says who is emulated on it: the others are real. `base_port` offers the USB port
    of the emulated base station, as TinyOS BaseStation, in the place of its host;
    `base_promiscuous` makes it hear everybody's messages and acknowledge none.
    """

    nav: str = ""
    proc: str = ""
    plant_for: str = ""
    plant: str = ""
    plant_rate_hz: Annotated[float, Meta(ge=10, le=1000)] = 100.0
    camera: str = ""
    camera_id: str = ""
    camera_clock: Literal["own", "unix", "monotonic"] = "own"
    camera_least_quality: Fraction = 0.0
    xbee: str = ""
    xbee_registers: XBeeRegisters = XBeeRegisters()
    xbee_restarts_s: tuple[Moment, ...] = ()
    mote: str = ""
    radio_nodes: Literal["both", "base", "robot"] = "both"
    base_port: str = ""
    base_promiscuous: bool = False
    late: Literal["report", "stop"] = "report"
    late_bound_s: Annotated[float, Meta(ge=0.0005, le=60)] = 0.1
    ping_period_s: Annotated[float, Meta(ge=0.02, le=60)] = 0.25

    @property
    def url(self) -> str:
        """The line to the real board; empty where all is emulated."""
        return self.nav or self.proc or self.plant_for

    @property
    def live(self) -> bool:
        """Whether anybody takes part from outside, so that the run keeps to real time."""
        return bool(self.url or self.camera or self.xbee or self.mote or self.base_port)

    @property
    def emulates_base(self) -> bool:
        """Whether the base station is emulated."""
        return self.radio_nodes != "robot"

    @property
    def emulates_robot(self) -> bool:
        """Whether any part of the robot is emulated."""
        return self.radio_nodes != "base" or bool(self.url)

    @property
    def emulates_robot_radio(self) -> bool:
        """Whether the robot's radio is emulated."""
        return self.radio_nodes != "base" and not self.proc

    @property
    def emulates_water(self) -> bool:
        """Whether the fish is in emulated water, so that anything true is known of it."""
        return self.emulates_robot and not (self.nav or self.plant)
