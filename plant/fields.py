"""Scalar fields in the tank that sensors look at: temperature, pollutant concentration.

A field is anything with ``value(x_m, y_m)``; this file holds the analytic one (uniform, gradient,
Gaussian plumes). A field from a grid of samples is another class with the same method. The
exponential is the project's own, so that readings are the same bits on every machine.
"""

from dataclasses import dataclass, field
from typing import Protocol

from plant.checks import check_number
from plant.elementary import exp, sincos


class Field(Protocol):
    """A steady scalar field over the tank."""

    def value(self, x_m: float, y_m: float) -> float:
        """Field at a point of the tank, in the field's own unit."""


@dataclass(frozen=True, slots=True)
class Plume:
    """An elliptic Gaussian: peak · exp(−½(ξ²/σ_along² + η²/σ_across²)).

    Its axes are turned by ``axis_rad``. The peak is in the field's unit and may be negative.
    """

    peak: float
    x_m: float = 0.0
    y_m: float = 0.0
    sigma_along_m: float = 1.0
    sigma_across_m: float = 1.0
    axis_rad: float = 0.0
    _axis: tuple[float, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse plumes without extent; sine and cosine of the axis are worked out once."""
        for name in ("peak", "x_m", "y_m", "axis_rad"):
            check_number(f"plume.{name}", getattr(self, name))
        for name in ("sigma_along_m", "sigma_across_m"):
            check_number(f"plume.{name}", getattr(self, name), above=0.0)
        object.__setattr__(self, "_axis", sincos(self.axis_rad))

    def value(self, x_m: float, y_m: float) -> float:
        """Contribution of this plume at a point."""
        sine, cosine = self._axis
        dx, dy = x_m - self.x_m, y_m - self.y_m
        along = (dx * cosine + dy * sine) / self.sigma_along_m
        across = (dy * cosine - dx * sine) / self.sigma_across_m
        return self.peak * exp(-0.5 * (along * along + across * across))


@dataclass(frozen=True, slots=True)
class AnalyticField:
    """Base value plus a constant gradient plus plumes, never below ``least``."""

    base: float = 0.0
    gradient_x_per_m: float = 0.0
    gradient_y_per_m: float = 0.0
    plumes: tuple[Plume, ...] = ()
    least: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no finite number."""
        for name in ("base", "gradient_x_per_m", "gradient_y_per_m"):
            check_number(f"field.{name}", getattr(self, name))
        if self.least is not None:
            check_number("field.least", self.least)

    def value(self, x_m: float, y_m: float) -> float:
        """Field at a point of the tank."""
        total = self.base + self.gradient_x_per_m * x_m + self.gradient_y_per_m * y_m
        for plume in self.plumes:
            total += plume.value(x_m, y_m)
        if self.least is not None and total < self.least:
            return self.least
        return total


def default_temperature_c() -> AnalyticField:
    """Water at 20 °C with a heated corner, like the heater in the source's section 6.5.1."""
    return AnalyticField(base=20.0, plumes=(Plume(peak=4.0, x_m=2.0, y_m=2.0),))


def default_pollutant_ug_l() -> AnalyticField:
    """Fluorescent pollutant, µg/L: a faint background and one drifting streak (made up)."""
    streak = Plume(peak=80.0, x_m=1.0, y_m=0.5, sigma_along_m=1.2, sigma_across_m=0.4, axis_rad=0.6)
    return AnalyticField(base=2.0, plumes=(streak,), least=0.0)
