"""What the tail is told: α₀ + α_A sin φ (3.25), with changes that keep the phase.

A ``TailBeat`` holds three numbers, a ``TailProgramme`` says when each beat begins, a ``Drive`` is
one beat as it reaches the servo, behind a delay and a lag where there are some. The phase runs
on across a change (φ̇ = 2πf is integrated, not restarted), so that a change of frequency makes no
jump of the angle. A step of the bias does make one: an ideal tail then jumps without an impulse,
as in the source; a servo does not follow it at once.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from plant.checks import check_number
from plant.compiled import compiled, compiled_apart
from plant.elementary import atan2
from plant.elementary import exp as _exp
from plant.elementary import sincos as _sincos
from plant.errors import InvalidParameterError
from plant.layout import Drive, Packed

sincos = compiled(_sincos)
exp = compiled_apart(_exp)

LEAST_SWEEP_S = 5e-3
"""Time in which an ideal tail passes a jump of its command half sweeping, half jumping (assumed:
a servo frame is four times as long). What is faster counts as the jump it is meant to be."""


@compiled
def swept_share(sweep_s: float) -> float:
    """Share of a jump that an ideal tail sweeps, if all of it took that time; it jumps the rest.

    A jump of an ideal tail has no impulse, as in the source, while a sweep through the same angle
    has the more the shorter it is: sooner or later one must become the other. The eighth power of
    the time lets speed and acceleration of what is swept vanish before the time is shorter than
    the integrator's step, which could not resolve them.
    """
    ratio = (sweep_s / LEAST_SWEEP_S) ** 8
    return ratio / (1.0 + ratio)


@dataclass(frozen=True, slots=True)
class TailBeat:
    """Bias α₀ (rad), amplitude α_A (rad), frequency (Hz) of the commanded tail angle."""

    bias_rad: float = 0.0
    amplitude_rad: float = 0.0
    frequency_hz: float = 0.0

    def __post_init__(self) -> None:
        """Refuse angles beyond a half turn and frequencies that no 1 ms step resolves."""
        check_number("tail_beat.bias_rad", self.bias_rad, least=-math.pi, most=math.pi)
        check_number("tail_beat.amplitude_rad", self.amplitude_rad, least=0.0, most=math.pi)
        check_number("tail_beat.frequency_hz", self.frequency_hz, least=0.0, most=100.0)

    @classmethod
    def degrees(cls, bias: float, amplitude: float, frequency_hz: float) -> "TailBeat":
        """Make a beat from angles in degrees, as the source's figures give them."""
        return cls(math.radians(bias), math.radians(amplitude), frequency_hz)


@dataclass(frozen=True, slots=True)
class TailProgramme:
    """Beats and the times (s) at which each begins; the first begins at 0 with ``phase_rad``."""

    beats: tuple[TailBeat, ...]
    starts_s: tuple[float, ...] = (0.0,)
    phase_rad: float = field(default=0.0)

    def __post_init__(self) -> None:
        """Refuse beats without a start, and starts out of order."""
        if not self.beats or len(self.beats) != len(self.starts_s):
            raise InvalidParameterError(
                "tail_programme.starts_s",
                f"{len(self.beats)} beats need as many starts, got {len(self.starts_s)}",
            )
        check_number("tail_programme.phase_rad", self.phase_rad)
        if self.starts_s[0] != 0.0:
            raise InvalidParameterError("tail_programme.starts_s", "the first beat begins at 0")
        for earlier, later in zip(self.starts_s, self.starts_s[1:], strict=False):
            check_number("tail_programme.starts_s", later, above=earlier)

    @classmethod
    def steady(cls, beat: TailBeat, phase_rad: float = 0.0) -> "TailProgramme":
        """One beat for ever."""
        return cls((beat,), (0.0,), phase_rad)

    def segments(
        self,
        step_s: float,
        delay_s: float = 0.0,
        lag_s: float = 0.0,
        speed_limit_rad_s: float = math.inf,
        swept: float = 1.0,
    ) -> list[tuple[int, Drive]]:
        """First grid index and drive of each beat.

        A change takes effect at the first grid point at or after its time: the integrator never
        steps across a jump, which would cost it its order. Behind a delay that is the first point
        at or after the time plus the delay, with the phase that the delayed command has there; the
        first beat counts as going on since ever, so that the motion changes smoothly with a delay.
        ``swept``: as in ``drive_of``.
        """
        result: list[tuple[int, Drive]] = []
        phase = float(self.phase_rad)
        previous = 0
        omega = 0.0
        before: Drive | None = None
        for start, beat in zip(self.starts_s, self.beats, strict=True):
            index = math.ceil(start / step_s - 1e-9)
            phase += omega * ((index - previous) * step_s)
            omega = 2.0 * math.pi * beat.frequency_hz
            begin = math.ceil((index * step_s + delay_s) / step_s - 1e-9) if result else 0
            late_s = begin * step_s - index * step_s - delay_s
            before = drive_of(
                beat,
                phase + omega * late_s,
                begin * step_s,
                lag_s,
                speed_limit_rad_s,
                before,
                swept,
            )
            result.append((begin, before))
            previous = index
        return result


def spans(segments: list[tuple[int, Drive]], steps: int) -> Iterator[tuple[Drive, int, int]]:
    """Yield each drive that begins within ``steps``, with its first and last grid point."""
    begun = [(first, drive) for first, drive in segments if first <= steps]
    for (first, drive), last in zip(begun, [*(k for k, _ in begun[1:]), steps], strict=True):
        yield drive, first, last


def drive_of(
    beat: TailBeat,
    phase_rad: float,
    start_s: float,
    lag_s: float = 0.0,
    speed_limit_rad_s: float = math.inf,
    before: Drive | None = None,
    swept: float = 1.0,
) -> Drive:
    """Make the drive of a beat that begins with a phase at a time of the run.

    Behind a first-order lag τ a beat keeps its form, with the amplitude divided by √(1 + ω²τ²) and
    atan ωτ less phase, plus a transient exp(−t/τ). Its size makes the angle go on where the drive
    ``before`` has come to, for the share ``swept`` of the way (the angle jumps the rest); without
    one there is none. So nothing is integrated, and τ may be as short as one likes.
    """
    omega = 2.0 * math.pi * beat.frequency_hz
    bias, amplitude, phase = float(beat.bias_rad), float(beat.amplitude_rad), phase_rad
    transient = 0.0
    if lag_s > 0.0:
        amplitude /= math.sqrt(1.0 + (omega * lag_s) ** 2)
        phase -= atan2(omega * lag_s, 1.0)
        if before is not None:
            old = told_angle(before, start_s - before.start, lag_s)
            transient = swept * (old - (bias + amplitude * _sincos(phase)[0]))
    return Drive(bias, amplitude, omega, phase, speed_limit_rad_s, start_s, transient)


def told_angle(drive: Drive, time_s: float, lag_s: float = 0.0) -> float:
    """Angle that a drive tells, ``time_s`` after its beginning: ``told`` outside compiled code."""
    value = drive.bias + drive.amplitude * _sincos(drive.phase + drive.omega * time_s)[0]
    if lag_s > 0.0:
        value += drive.transient * _exp(-time_s / lag_s)
    return value


@compiled
def beat(drive: Drive, time_s: float) -> tuple[float, float, float]:
    """Commanded angle with its first and second derivative, ``time_s`` after the beginning."""
    if drive.amplitude == 0.0:
        return drive.bias, 0.0, 0.0
    sine, cosine = sincos(drive.phase + drive.omega * time_s)
    speed = drive.amplitude * drive.omega
    return drive.bias + drive.amplitude * sine, speed * cosine, -speed * drive.omega * sine


@compiled
def told(p: Packed, drive: Drive, time_s: float) -> tuple[float, float, float]:
    """``beat`` with the transient of a lag, as it reaches the servo."""
    target, target_dot, target_ddot = beat(drive, time_s)
    if p.lag_rate != 0.0:
        rest = drive.transient * exp(-time_s * p.lag_rate)
        target += rest
        target_dot -= rest * p.lag_rate
        target_ddot += rest * p.lag_rate * p.lag_rate
    if drive.curved != 0.0:
        rise = drive.slope + time_s * (drive.bend + time_s * drive.twist)
        target += drive.offset + time_s * rise
        target_dot += drive.slope + time_s * (2.0 * drive.bend + time_s * 3.0 * drive.twist)
        target_ddot += 2.0 * drive.bend + 6.0 * drive.twist * time_s
    return target, target_dot, target_ddot
