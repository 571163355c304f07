"""The servo as an actuator: a position loop around a motor with lag, a speed limit and a dead band.

    speed command = clip(k_p · dead zone(target − α), ± limit),   α̈ = (speed command − α̇)/τ_m

The limit follows the supply voltage. Without power it is zero: the motor stops within its lag and
gear friction holds the tail where it is. The dead band is written as a dead zone, continuous at
its edges; an on-off band would make the loop chatter there at the step of the integrator.

The torque of the water (about 1 mN·m) is a thousandth of what the servo can give, so it does not
slow the motion; it shows in the current only.
"""

from plant.compiled import compiled
from plant.layout import Drive, Packed, State, TailMotion
from plant.parameters import Servo
from plant.tail_input import beat


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


@compiled
def tail_motion(p: Packed, drive: Drive, time_s: float, s: State) -> TailMotion:
    """What the tail does: an ideal one what it is told, a real one what its servo makes it do."""
    target, target_dot, target_ddot = beat(drive, time_s)
    if p.servo_ideal != 0.0:
        return TailMotion(target, target_dot, target_ddot, drive.bias)
    acceleration = tail_acceleration(p, drive.speed_limit, target, s.alpha, s.alpha_dot)
    return TailMotion(s.alpha, s.alpha_dot, acceleration, s.alpha_mean)


def current_slopes(servo: Servo, volts: float) -> tuple[float, float, float]:
    """Idle current (A), current per speed (A/(rad/s)) and per load torque (A/(N·m)) at a supply."""
    full_speed, full_torque = servo.speed_limit_rad_s(volts), servo.stall_torque_n_m(volts)
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
