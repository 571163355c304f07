"""From command to tail: the servo, and the linkage behind it."""

from tools.diagnosis.fish.setup import Row, physical
from tools.diagnosis.model import Cause, Parameter


def _row(
    name: str,
    short: str,
    unit: str,
    bounds: tuple[float, float],
    scale: float,
    words: tuple[str, str],
) -> Row:
    description, statement = words
    parameter = Parameter(f"{name}.{short}", unit, *bounds, scale=scale)
    return Row(Cause(name, description, (parameter,), statement), physical(name))


ROWS = (
    _row(
        "tail_offset",
        "delta_rad",
        "rad",
        (-0.8, 0.8),
        5e-3,
        (
            "the tail stands off the commanded bias",
            (
                "The tail is mounted askew: it always stands {delta_rad:+.3f} rad from where it is "
                "told to be."
            ),
        ),
    ),
    _row(
        "tail_gain",
        "g",
        "",
        (-0.95, 1.5),
        0.02,
        (
            "the tail deflects more or less than it is told to",
            "The tail swings (1 {g:+.3f}) times as far as it is told to.",
        ),
    ),
    _row(
        "tail_fade",
        "k_per_s",
        "1/s",
        (-0.02, 0.05),
        2e-4,
        (
            "the tail's deflection falls during a run",
            (
                "The tail's swing shrinks during a run, by a share of {k_per_s:.5f} of the whole "
                "each second, as with a battery that runs down."
            ),
        ),
    ),
    _row(
        "servo_lag",
        "tau_s",
        "s",
        (0.0, 1.0),
        6e-3,
        (
            "the tail follows its command with a first-order lag",
            (
                "The tail lags behind its command: it needs about {tau_s:.3f} s to follow it (a "
                "first-order lag)."
            ),
        ),
    ),
    _row(
        "servo_delay",
        "delay_s",
        "s",
        (0.0, 1.0),
        6e-3,
        (
            "commands reach the tail late",
            "Every command reaches the tail {delay_s:.3f} s late.",
        ),
    ),
    _row(
        "servo_rate_limit",
        "excess_s_rad",
        "s/rad",
        (0.0, 5.0),
        0.5,
        (
            "the servo has a largest speed",
            (
                "The servo is too slow for its commands: it needs {excess_s_rad:.3f} s for each "
                "radian at least."
            ),
        ),
    ),
    _row(
        "servo_deadband",
        "delta_rad",
        "rad",
        (0.0, 0.5),
        1e-3,
        (
            "the servo does not react to small differences",
            (
                "The servo stands still while command and position differ by less than "
                "{delta_rad:.3f} rad."
            ),
        ),
    ),
    _row(
        "servo_backlash",
        "play_rad",
        "rad",
        (0.0, 1.0),
        2e-3,
        (
            "there is play between servo and tail",
            "There is play of {play_rad:.3f} rad between servo and tail.",
        ),
    ),
)
