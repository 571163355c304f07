"""What the tail is told: α₀ + α_A sin φ (3.25), with changes that keep the phase.

A ``TailBeat`` holds three numbers, a ``TailProgramme`` says when each beat begins. The phase runs
on across a change (φ̇ = 2πf is integrated, not restarted), so that a change of frequency makes no
jump of the angle. A step of the bias does make one: an ideal tail then jumps without an impulse,
as in the source; a servo does not follow it at once.
"""

import math
from dataclasses import dataclass, field

from plant.compiled import compiled
from plant.elementary import sincos as _sincos
from plant.errors import InvalidParameterError
from plant.layout import Drive
from plant.parameters import check_number

sincos = compiled(_sincos)


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

    def segments(self, step_s: float) -> list[tuple[int, Drive]]:
        """First grid index and drive of each beat.

        A change takes effect at the first grid point at or after its time: the integrator never
        steps across a jump, which would cost it its order.
        """
        result: list[tuple[int, Drive]] = []
        phase = float(self.phase_rad)
        previous = 0
        omega = 0.0
        for start, beat in zip(self.starts_s, self.beats, strict=True):
            index = math.ceil(start / step_s - 1e-9)
            phase += omega * ((index - previous) * step_s)
            omega = 2.0 * math.pi * beat.frequency_hz
            drive = Drive(
                float(beat.bias_rad), float(beat.amplitude_rad), omega, phase, speed_limit=math.inf
            )
            result.append((index, drive))
            previous = index
        return result


@compiled
def beat(drive: Drive, time_s: float) -> tuple[float, float, float]:
    """Commanded tail angle with its first and second derivative, ``time_s`` after the start."""
    if drive.amplitude == 0.0:
        return drive.bias, 0.0, 0.0
    sine, cosine = sincos(drive.phase + drive.omega * time_s)
    speed = drive.amplitude * drive.omega
    return drive.bias + drive.amplitude * sine, speed * cosine, -speed * drive.omega * sine
