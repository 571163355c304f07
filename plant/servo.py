"""The servo as an actuator: a position loop around a motor with lag, a speed limit and a dead band.

    speed command = clip(k_p · dead zone(target − α), ± limit),   α̈ = (speed command − α̇)/τ_m

The limit follows the supply voltage. Without power it is zero: the motor stops within its lag and
gear friction holds the tail where it is. The dead band is written as a dead zone, continuous at
its edges; an on-off band would make the loop chatter there at the step of the integrator.

Between command and tail stand, in this order: delay and lag of the command (``tail_input``), the
servo, play, and the linkage. An ideal servo follows its command c exactly; given a largest speed V
or a dead band δ it is a state (θ, θ̇) with the structure of the real one's loop,

    θ̈ = (clip(dz(c + 2τ ċ + τ² c̈ − θ, δ)/2τ, ± V) − θ̇)/½τ,      dz the dead zone, τ the motor lag

which stays on c exactly while neither binds (then τ² θ̈ + 2τ θ̇ + θ is the lead in the bracket), on
c ∓ δ while it pushes, coasts to rest within the band, and tends to the pure play and ramp as τ → 0.
Of first order the tail's acceleration would jump at each edge, and the step of the integrator that
crosses it would leave an error of its own length in the body's velocities. The tail behind play is
the same operator on the servo's motion.

The torque of the water (about 1 mN·m) is a thousandth of what the servo can give, so it does not
slow the motion; it shows in the current only.
"""

import math

from plant.arrays import FloatArray
from plant.compiled import compiled, compiled_apart
from plant.layout import STATE, Drive, Packed, State, TailMotion
from plant.packing import pack
from plant.parameters import PlantParameters, Servo
from plant.tail_input import swept_share, told


@compiled
def tail_acceleration(
    p: Packed, speed_limit: float, target: float, alpha: float, alpha_dot: float
) -> float:
    """Angular acceleration of the tail (rad/s²) under the servo's position loop."""
    error = target - alpha
    dead = p.servo_dead_band
    if error > dead:
        error -= dead
    elif error < -dead:
        error += dead
    else:
        error = 0.0
    speed = p.servo_gain * error
    if speed > speed_limit:
        speed = speed_limit
    elif speed < -speed_limit:
        speed = -speed_limit
    return (speed - alpha_dot) * p.servo_rate


@compiled_apart
def dragged(
    width: float,
    largest: float,
    rate: float,
    lead: tuple[float, float, float],
    angle: float,
    angle_dot: float,
) -> float:
    """Angular acceleration (rad/s²) of what is dragged along within a dead zone.

    ``lead``: angle, rate and acceleration of what drags; ``width``: half width of the dead zone;
    ``largest``: speed limit; ``rate``: 1/τ.
    """
    error = lead[0] - angle + (2.0 * lead[1] + lead[2] / rate) / rate
    if error > width:
        error -= width
    elif error < -width:
        error += width
    else:
        error = 0.0
    speed = 0.5 * rate * error
    if speed > largest:
        speed = largest
    elif speed < -largest:
        speed = -largest
    return (speed - angle_dot) * (2.0 * rate)


@compiled
def tail_motion(p: Packed, drive: Drive, time_s: float, s: State) -> TailMotion:
    """What the tail does: an ideal one what it is told, a real one what its servo makes it do."""
    target, target_dot, target_ddot = told(p, drive, time_s)
    if p.servo_ideal == 0.0:
        mean = s.alpha_mean
        servo, servo_dot = s.servo, s.servo_dot
        servo_ddot = tail_acceleration(p, drive.speed_limit, target, servo, servo_dot)
    else:
        mean = drive.bias
        servo, servo_dot, servo_ddot = target, target_dot, target_ddot
        if p.servo_tracks != 0.0:
            servo, servo_dot = s.servo, s.servo_dot
            servo_ddot = dragged(
                p.servo_dead_band,
                p.servo_speed,
                p.servo_rate,
                (target, target_dot, target_ddot),
                servo,
                servo_dot,
            )
    if p.loosened != 0.0:
        return behind_linkage(
            p,
            drive.start + time_s,
            (servo, servo_dot, servo_ddot),
            (s.loose, s.loose_dot),
            mean,
        )
    return TailMotion(
        servo,
        servo_dot,
        servo_ddot,
        mean,
        servo,
        servo_dot,
        servo_ddot,
        servo,
        servo_dot,
        0.0,
    )


@compiled_apart
def behind_linkage(
    p: Packed,
    run_s: float,
    servo: tuple[float, float, float],
    loose: tuple[float, float],
    mean: float,
) -> TailMotion:
    """What the tail does behind play and linkage.

    ``servo``: angle, rate, acceleration; ``loose``: angle and rate behind the play.
    """
    alpha, alpha_dot, alpha_ddot = servo
    loose_ddot = 0.0
    if p.play != 0.0:
        alpha, alpha_dot = loose
        alpha_ddot = dragged(p.play, math.inf, p.servo_rate, servo, alpha, alpha_dot)
        loose_ddot = alpha_ddot
    behind_play, behind_play_dot = alpha, alpha_dot
    left = 1.0 - p.linkage_fade * run_s
    fade = p.linkage_gain * p.linkage_fade
    if left < 0.0:
        left, fade = 0.0, 0.0
    gain = p.linkage_gain * left
    return TailMotion(
        gain * alpha + p.linkage_offset,
        gain * alpha_dot - fade * alpha,
        gain * alpha_ddot - 2.0 * fade * alpha_dot,
        mean if p.servo_ideal == 0.0 else gain * mean + p.linkage_offset,
        servo[0],
        servo[1],
        servo[2],
        behind_play,
        behind_play_dot,
        loose_ddot,
    )


def lag_share(servo: Servo) -> float:
    """Share of a jump of the command that goes through the lag; the rest jumps (an ideal tail's).

    A real servo sweeps through a jump anyhow, and hears the whole of it through the lag.
    """
    return swept_share(servo.command_lag_s) if servo.ideal else 1.0


def carry_over(
    parameters: PlantParameters, before: Drive | None, drive: Drive, state: FloatArray
) -> None:
    """Bring the servo's state (in place) to a drive that begins: what an ideal tail does at a jump.

    At the beginning of a run (``before`` None) an ideal servo is where it is told to be, and as
    fast if it can. Later a jump of the command takes it along (``carried_over``). A real servo does
    not jump.
    """
    if not parameters.servo.ideal:
        return
    p = Packed(*(float(value) for value in pack(parameters)))
    s = State(*state[:STATE].tolist())
    state[:STATE] = standing(p, drive, s) if before is None else carried_over(p, before, drive, s)


@compiled_apart
def standing(p: Packed, drive: Drive, s: State) -> State:
    """Return the state with an ideal servo, and what is behind its play, where they are told."""
    angle, rate, _ = told(p, drive, 0.0)
    rate = min(max(rate, -p.servo_speed), p.servo_speed)
    return State(s.x, s.y, s.psi, s.u, s.v, s.r, angle, rate, s.alpha_mean, angle, rate)


@compiled_apart
def carried_over(p: Packed, before: Drive, after: Drive, s: State) -> State:
    """Return the state of an ideal servo where one drive takes over from another.

    A jump of the command takes the servo along, as far as it drags it, and so the tail behind its
    play; with a largest speed the servo sweeps through a share of the jump instead.
    """
    if p.servo_tracks == 0.0 and p.play == 0.0:
        return s
    time_s = after.start - before.start
    angle, rate, _ = told(p, after, 0.0)
    old, old_rate, _ = told(p, before, time_s)
    servo, servo_dot = s.servo, s.servo_dot
    if p.servo_tracks != 0.0:
        jump = 1.0 - swept_share(abs(angle - old) / p.servo_speed)
        whole, whole_rate = _taken_along(
            p.servo_dead_band, old, old_rate, angle, rate, servo, servo_dot
        )
        whole_rate = min(max(whole_rate, -p.servo_speed), p.servo_speed)
        old, old_rate = servo, servo_dot
        servo += jump * (whole - servo)
        servo_dot += jump * (whole_rate - servo_dot)
        angle, rate = servo, servo_dot
    loose, loose_dot = s.loose, s.loose_dot
    if p.play != 0.0:
        loose, loose_dot = _taken_along(p.play, old, old_rate, angle, rate, loose, loose_dot)
    return State(s.x, s.y, s.psi, s.u, s.v, s.r, servo, servo_dot, s.alpha_mean, loose, loose_dot)


@compiled_apart
def _taken_along(
    width: float,
    old: float,
    old_rate: float,
    new: float,
    new_rate: float,
    angle: float,
    rate: float,
) -> tuple[float, float]:
    """Angle and rate, after a jump from ``old`` to ``new``, of what is dragged within ``width``.

    What stood at the edge stands there again where the edge came on, and takes over the change of
    rate as far as it stands at the edge; what stood off farther keeps that distance.
    """
    reach = max(width, abs(old - angle))
    angle = min(max(angle, new - reach), new + reach)
    share = min(1.0, abs(new - angle) / width) if width > 0.0 else 1.0
    return angle, rate + share * (new_rate - old_rate)


def current_slopes(servo: Servo, volts: float) -> tuple[float, float, float]:
    """Idle current (A), current per speed (A/(rad/s)) and per load torque (A/(N·m)) at a supply."""
    full_speed, full_torque = servo.no_load_speed_rad_s(volts), servo.stall_torque_n_m(volts)
    if full_speed <= 0.0 or full_torque <= 0.0:
        return 0.0, 0.0, 0.0
    return (
        servo.idle_current_a,
        servo.running_current_a / full_speed,
        (servo.stall_current_a - servo.idle_current_a) / full_torque,
    )


def supply_current_a(
    servo: Servo, volts: float, speed_rad_s: float, hinge_moment_n_m: float
) -> float:
    """Supply current: idle, plus friction in proportion to speed, plus load torque.

    The two published points are met: full speed without load takes the running current, stall at
    full torque the stall current. Between them the curve is linear (a DC motor's), as assumed here.
    The load is the moment that the water puts on the joint; holding against it costs as driving.
    """
    idle, per_speed, per_torque = current_slopes(servo, volts)
    current = idle + per_speed * abs(speed_rad_s) + per_torque * abs(hinge_moment_n_m)
    return min(current, servo.stall_current_a)
