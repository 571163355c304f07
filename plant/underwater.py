"""What a testbed asks of a vehicle in the water, whatever moves it and in how many directions.

The bench knows a vehicle by this protocol only. ``vehicle.Vehicle`` (surge, sway and yaw, with a
tail) has it. A vehicle that moves in a vertical plane or in space (heave, pitch, roll, buoyancy, a
moving mass) is another class with the same methods: its pose in the plane is the one that the
camera and the radio see, and what it has beyond them (depth, attitude, further actuators) it offers
beside, to the instruments and drivers that want it. docs/extending.md says where each is tied in.

Time is a count of femtoseconds. Looks must not go back behind the latest look; an input takes
effect at the first grid point at or after its time; who looks when changes nothing that others see.
"""

from typing import Protocol

from plant.arrays import FloatArray
from plant.parameters import Servo
from plant.tail_input import TailBeat


class Pose(Protocol):
    """Where it is, in the tank frame: for camera, radio, fields."""

    def x(self, t_fs: int) -> float:
        """Position of the body centre, m."""

    def y(self, t_fs: int) -> float:
        """Position of the body centre, m."""

    def position(self, t_fs: int) -> tuple[float, float]:
        """``x`` and ``y`` in one look, m."""

    def heading(self, t_fs: int) -> float:
        """Heading ψ of the body's x axis counter-clockwise from +x, unwrapped, rad."""


class Motion(Protocol):
    """How it moves, in body axes: for gyro and accelerometer; over the ground: for a GPS."""

    def r(self, t_fs: int) -> float:
        """Yaw rate, rad/s."""

    def body_acceleration_x(self, t_fs: int) -> float:
        """Proper acceleration of the body centre along body x, m/s², without gravity."""

    def body_acceleration_y(self, t_fs: int) -> float:
        """Proper acceleration of the body centre along body y, m/s², without gravity."""

    def ground_velocity_x(self, t_fs: int) -> float:
        """Velocity over the tank's floor along its x axis, m/s."""

    def ground_velocity_y(self, t_fs: int) -> float:
        """Velocity over the tank's floor along its y axis, m/s."""


class TailServo(Protocol):
    """Its tail and the servo that drives it. Inputs come in the order of their times."""

    @property
    def servo(self) -> Servo:
        """The servo's data; an ideal one takes beats, a real one targets and a supply."""

    def set_servo_target(self, t_fs: int, angle_rad: float | None) -> None:
        """Give the servo a target, or release it."""

    def set_tail_beat(self, t_fs: int, beat: TailBeat) -> None:
        """Command an ideal tail."""

    def set_supply(self, t_fs: int, volts: float) -> None:
        """Change the servo's supply."""

    def servo_current(self, t_fs: int) -> float:
        """Supply current of the servo, A."""

    def tail_angle(self, t_fs: int) -> float:
        """True tail angle, rad."""

    def tail_points(self, until_fs: int, last: int) -> FloatArray:
        """Points along the tail at the last rows of ``truth`` (rows, points, 2), body axes, m."""


class UnderwaterVehicle(Pose, Motion, TailServo, Protocol):
    """Everything that the bench asks. Every look may raise ``DivergedError``."""

    @property
    def truth_columns(self) -> tuple[str, ...]:
        """Names of the columns of ``truth``, beginning with time, position and heading."""

    def advance(self, t_fs: int) -> None:
        """Move to a time without looking at anything."""

    def truth(self, until_fs: int) -> FloatArray:
        """Rows (n, columns) at every history point from 0 to a time."""
