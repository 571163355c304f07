"""The records that compiled code works on, and the columns of what it saves.

Compiled functions take and return named tuples of floats: they live in registers, need no
reference counts (four array arguments cost more than the physics of a step), and read like the
equations. Only at the border to Python are they vectors, in the order given here. Parameters for
people are the dataclasses of ``parameters``; ``packing.pack`` makes ``Packed`` of them. To add
an effect: a field here with its neutral value in ``parameters``, and its term in the right-hand
side.
"""

from enum import IntEnum
from typing import NamedTuple


class Packed(NamedTuple):
    """Parameters, in SI units, with products that do not change during a run taken once."""

    m1: float  # m_b − X_u̇, kg
    m2: float  # m_b − Y_v̇, kg
    j3: float  # J_bz − N_ṙ, kg·m²
    hinge: float  # c, centre to tail joint, m
    half_rho_s: float  # ½ρS, kg/m
    drag: float  # C_D (or C′_D0)
    drag_bias: float  # C′_D1, 1/rad²  (3.32)
    lift: float  # C_L, 1/rad
    lift_bias: float  # C′_L, 1/rad  (3.34)
    linear_drag: float  # b, N·s/m
    yaw_drag: float  # K_D (or K′_D0), N·m·s²
    yaw_drag_bias: float  # K′_D1, N·m·s²/rad  (3.33)
    tail_length: float  # L, m
    tail_mass: float  # m(L), m = ¼πρd² virtual mass per length, kg/m
    tail_first: float  # ∫m dτ, of a uniform tail mL, kg
    tail_second: float  # ∫mτ dτ, ½mL², kg·m
    tail_third: float  # ∫mτ² dτ, ⅓mL³, kg·m²
    taper_first: float  # ∫m dτ − m(L) L, kg; 0 for a uniform tail
    taper_second: float  # ∫mτ dτ − ½ m(L) L², kg·m
    body_motion: float  # share of the body motion seen by the tail: 1 full, 0 ignored (3.30)
    munk: float  # share of the coupling (Y_v̇ − X_u̇)uv in (3.7)
    current_x: float  # water velocity in the tank frame (at the origin), m/s
    current_y: float
    placed: float  # 1: shear or walls make forces depend on the place
    shear_x: float  # ∂U_x/∂y, 1/s
    shear_y: float  # ∂U_y/∂x, 1/s
    mass: float  # m_b, kg
    wall_drag: float  # rise of the drag at a wall
    wall_stiffness: float  # of the contact, N/m
    x_min: float  # walls in the tank frame, m; infinite where there is none
    y_min: float
    x_max: float
    y_max: float
    lag_rate: float  # 1 / lag of the command, 1/s; 0: no lag
    servo_ideal: float  # 1: the tail is where it is told to be; 0: the servo moves it
    servo_tracks: float  # 1: an ideal servo with a largest speed or a dead band, which has a state
    servo_speed: float  # largest speed of such a servo, rad/s; infinite without a limit
    servo_gain: float  # k_p, 1/s
    servo_rate: float  # 1/τ_m, 1/s
    servo_dead_band: float  # half width, rad
    loosened: float  # 1: play or linkage is not neutral
    play: float  # half width between servo and tail, rad
    linkage_gain: float  # 1 + g, tail angle over servo angle at t = 0
    linkage_fade: float  # k, 1/s
    linkage_offset: float  # δ, rad
    bias_forgetting: float  # 1 / time constant of the running mean of the tail angle, 1/s


class Drive(NamedTuple):
    """What the servo is told: bias + amplitude · sin(phase + ω t), t since the drive's beginning.

    Behind a lag, amplitude and phase are those of the lagged beat, and ``transient`` is what is
    left of the time before at the beginning; it dies out with the lag.

    Where ``curved`` is not zero, offset + slope t + bend t² + twist t³ is added: a piece of a
    spline through recorded commands. The bias is then that which the adapted drag depends on.
    """

    bias: float  # rad
    amplitude: float  # rad
    omega: float  # rad/s
    phase: float  # rad, at t = 0
    speed_limit: float  # largest speed of the servo, rad/s; 0: no power
    start: float = 0.0  # of this drive since the start of the run, s
    transient: float = 0.0  # rad
    curved: float = 0.0
    offset: float = 0.0  # rad
    slope: float = 0.0  # rad/s
    bend: float = 0.0  # rad/s²
    twist: float = 0.0  # rad/s³


class State(NamedTuple):
    """What is integrated. An ideal tail leaves the last five alone: it has no state."""

    x: float  # m, tank frame
    y: float
    psi: float  # rad, counter-clockwise from +x, unwrapped
    u: float  # m/s through the water, body axes
    v: float
    r: float  # rad/s
    servo: float  # angle of the servo, rad: the tail's, but for play and linkage
    servo_dot: float  # rad/s
    alpha_mean: float  # running mean of the tail angle, rad
    loose: float = 0.0  # angle behind the play, rad; meaningless where there is none
    loose_dot: float = 0.0  # rad/s


class TailMotion(NamedTuple):
    """What the tail does at this moment, what moves it, and the bias of the adapted drag."""

    alpha: float  # true tail angle, rad
    alpha_dot: float  # rad/s
    alpha_ddot: float  # rad/s²
    mean: float  # rad, the bias of (3.32–3.34)
    servo: float  # angle of the servo, rad
    servo_dot: float  # rad/s
    servo_ddot: float  # rad/s²
    loose: float  # angle behind the play, rad
    loose_dot: float  # rad/s
    loose_ddot: float  # rad/s²; 0 where there is no play


class Rates(NamedTuple):
    """Derivatives of the state, then what the tail does at this moment."""

    x_dot: float
    y_dot: float
    psi_dot: float
    u_dot: float
    v_dot: float
    r_dot: float
    servo_dot: float
    servo_ddot: float
    alpha_mean_dot: float
    loose_dot: float
    loose_ddot: float
    alpha: float  # true tail angle, rad
    alpha_dot: float
    alpha_ddot: float
    alpha_mean: float  # its mean, the bias of (3.32–3.34)
    servo: float  # angle of the servo, rad (the state's, or an ideal one's)
    loose: float  # angle behind the play, rad
    force_x: float  # F_hx, hydrodynamic force of the tail on the body, N
    force_y: float  # F_hy
    hinge_moment: float  # of the tail's hydrodynamic force about the joint A, N·m


class Column(IntEnum):
    """Columns of a saved row. The tail's are those of the true tail, behind play and linkage."""

    X = 0
    Y = 1
    PSI = 2
    U = 3
    V = 4
    R = 5
    ALPHA = 6
    ALPHA_DOT = 7
    ALPHA_MEAN = 8
    X_DOT = 9
    Y_DOT = 10
    U_DOT = 11
    V_DOT = 12
    R_DOT = 13
    ALPHA_DDOT = 14
    FORCE_X = 15
    FORCE_Y = 16
    HINGE_MOMENT = 17
    SERVO = 18
    SERVO_DOT = 19
    LOOSE = 20
    LOOSE_DOT = 21


STATE_COLUMNS = (
    *range(int(Column.X), int(Column.R) + 1),
    int(Column.SERVO),
    int(Column.SERVO_DOT),
    int(Column.ALPHA_MEAN),
    int(Column.LOOSE),
    int(Column.LOOSE_DOT),
)
"""Columns of a row that hold the state, in the order of ``State``."""


ROW = len(Column)
"""Length of a saved row."""

PACKED, DRIVE, STATE = len(Packed._fields), len(Drive._fields), len(State._fields)
"""Lengths of the records as vectors."""
