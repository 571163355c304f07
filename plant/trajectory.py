"""Where a run starts and what it leaves: plain arrays on the integrator's grid, read by name."""

from dataclasses import dataclass

from plant.arrays import FloatArray
from plant.checks import check_number
from plant.elementary import sincos
from plant.layout import Column, State
from plant.parameters import Water


@dataclass(frozen=True, slots=True)
class Start:
    """Initial state. ``u``, ``v`` are through the water; the default is the origin, at rest.

    ``tail_angle_rad``: where a real servo stands; an ideal one begins where it is told to be.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0
    u_m_s: float = 0.0
    v_m_s: float = 0.0
    r_rad_s: float = 0.0
    tail_angle_rad: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no finite number, and speeds that no such robot has."""
        for name in ("x_m", "y_m", "heading_rad", "tail_angle_rad"):
            check_number(f"start.{name}", getattr(self, name))
        for name in ("u_m_s", "v_m_s", "r_rad_s"):
            check_number(f"start.{name}", getattr(self, name), least=-50.0, most=50.0)

    @classmethod
    def at_rest(cls, water: Water, x_m: float, y_m: float, heading_rad: float) -> "Start":
        """Start at rest in the *tank*: in a current, the water then flows past the robot."""
        sine, cosine = sincos(heading_rad)
        cx, cy = water.current_m_s(x_m, y_m)
        if cx == 0.0 and cy == 0.0:
            return cls(x_m, y_m, heading_rad)
        return cls(
            x_m,
            y_m,
            heading_rad,
            u_m_s=-(cx * cosine + cy * sine),
            v_m_s=cx * sine - cy * cosine,
        )

    def state(self) -> State:
        """Return the integrator's state; the tail's mean angle starts at its angle."""
        return State(
            float(self.x_m),
            float(self.y_m),
            float(self.heading_rad),
            float(self.u_m_s),
            float(self.v_m_s),
            float(self.r_rad_s),
            float(self.tail_angle_rad),
            0.0,
            float(self.tail_angle_rad),
            float(self.tail_angle_rad),
        )


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Saved grid points: ``time_s`` (n,) and ``rows`` (n, ROW), columns as in ``layout.Column``."""

    time_s: FloatArray
    rows: FloatArray

    def column(self, column: Column) -> FloatArray:
        """One column as a view (n,)."""
        return self.rows[:, int(column)]

    @property
    def x_m(self) -> FloatArray:
        """Position in the tank, m."""
        return self.column(Column.X)

    @property
    def y_m(self) -> FloatArray:
        """Position in the tank, m."""
        return self.column(Column.Y)

    @property
    def heading_rad(self) -> FloatArray:
        """Heading counter-clockwise from +x, unwrapped, rad."""
        return self.column(Column.PSI)

    @property
    def u_m_s(self) -> FloatArray:
        """Surge velocity through the water, m/s."""
        return self.column(Column.U)

    @property
    def v_m_s(self) -> FloatArray:
        """Sway velocity through the water, m/s."""
        return self.column(Column.V)

    @property
    def r_rad_s(self) -> FloatArray:
        """Yaw rate, rad/s."""
        return self.column(Column.R)

    @property
    def tail_angle_rad(self) -> FloatArray:
        """True tail angle α, rad."""
        return self.column(Column.ALPHA)

    @property
    def tail_force_x_n(self) -> FloatArray:
        """Hydrodynamic force of the tail on the body F_hx, N."""
        return self.column(Column.FORCE_X)

    @property
    def tail_force_y_n(self) -> FloatArray:
        """Hydrodynamic force of the tail on the body F_hy, N."""
        return self.column(Column.FORCE_Y)

    @property
    def hinge_moment_n_m(self) -> FloatArray:
        """Moment of the tail's hydrodynamic force about the joint, N·m."""
        return self.column(Column.HINGE_MOMENT)
