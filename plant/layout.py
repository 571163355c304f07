"""Where each number stands in the vectors that compiled code works on.

Compiled functions take flat float64 vectors, since these cross the border from Python in a
fraction of a microsecond and stack into ensembles. Parameters for people are the dataclasses of
``parameters``; ``parameters.pack`` makes the vector. To add an effect: a row here with its neutral
value in ``parameters``, and its term in the right-hand side.
"""

from enum import IntEnum


class Packed(IntEnum):
    """Parameters, in SI units, with products that do not change during a run taken once."""

    M1 = 0  # m_b − X_u̇, kg
    M2 = 1  # m_b − Y_v̇, kg
    J3 = 2  # J_bz − N_ṙ, kg·m²
    HINGE = 3  # c, centre to tail joint, m
    HALF_RHO_S = 4  # ½ρS, kg/m
    DRAG = 5  # C_D (or C′_D0)
    DRAG_BIAS = 6  # C′_D1, 1/rad²  (3.32)
    LIFT = 7  # C_L, 1/rad
    YAW_DRAG = 8  # K_D (or K′_D0), N·m·s²
    YAW_DRAG_BIAS = 9  # K′_D1, N·m·s²/rad  (3.33)
    TAIL_LENGTH = 10  # L, m
    TAIL_MASS = 11  # m = ¼πρd², virtual mass per length, kg/m
    TAIL_FIRST = 12  # mL = ∫m dτ, kg
    TAIL_SECOND = 13  # ½mL² = ∫mτ dτ, kg·m
    TAIL_THIRD = 14  # ⅓mL³ = ∫mτ² dτ, kg·m²
    BODY_MOTION = 15  # share of the body motion seen by the tail: 1 full, 0 ignored (3.30)
    MUNK = 16  # share of the coupling (Y_v̇ − X_u̇)uv in (3.7)
    CURRENT_X = 17  # water velocity in the tank frame, m/s
    CURRENT_Y = 18
    SERVO_IDEAL = 19  # 1: the tail is where it is told to be; 0: the servo moves it
    SERVO_GAIN = 20  # k_p, 1/s
    SERVO_LAG = 21  # τ_m, s
    SERVO_DEADBAND = 22  # half width, rad
    BIAS_MEMORY = 23  # time constant of the running mean of the tail angle, s


class Drive(IntEnum):
    """What the tail is told: target(t) = bias + amplitude · sin(phase + ω t), t since the start."""

    BIAS = 0  # rad
    AMPLITUDE = 1  # rad
    OMEGA = 2  # rad/s
    PHASE = 3  # rad, at t = 0
    SPEED_LIMIT = 4  # largest speed of the servo, rad/s; 0: no power


class Column(IntEnum):
    """A saved row: the state, its rates, and the tail's loads at a grid point."""

    X = 0  # m, tank frame
    Y = 1
    PSI = 2  # rad, counter-clockwise from +x, unwrapped
    U = 3  # m/s through the water, body axes
    V = 4
    R = 5  # rad/s
    ALPHA = 6  # tail angle, rad
    ALPHA_DOT = 7  # rad/s
    ALPHA_MEAN = 8  # running mean of the tail angle, rad (the bias of 3.32, 3.33)
    X_DOT = 9
    Y_DOT = 10
    PSI_DOT = 11
    U_DOT = 12
    V_DOT = 13
    R_DOT = 14
    ALPHA_RATE = 15
    ALPHA_DDOT = 16
    ALPHA_MEAN_DOT = 17
    FORCE_X = 18  # F_hx, hydrodynamic force of the tail on the body, N
    FORCE_Y = 19  # F_hy
    HINGE_MOMENT = 20  # moment of the tail's hydrodynamic force about the joint A, N·m


STATES = 9
"""Length of the state; the same number of rates follows it in a row."""

ROW = 21
"""Length of a saved row."""
