"""A force on the body that no part of the model explains: a sum of simple terms, neutral if empty.

A coefficient is called AXIS:TERM, such as ``surge:u|u|``, and is in newtons (newton metres for yaw)
per unit of its term. Its axis is one of the body's, or of the tank's: what holds a robot to a place
turns with it. In the terms u, v, r are the body's velocities, a the tail's angle α, a_dot its rate,
t the time of the run, x and y the place in the tank. The force makes F/(m_b − X_u̇), F/(m_b − Y_v̇)
and M/(J_bz − N_ṙ): the tail's own share of the inertia is left out, since such a force is an
empirical one anyhow. How it acts is in ``pushed``; robots without one never meet that code.
"""

from dataclasses import dataclass
from typing import ClassVar

from plant.checks import check_number
from plant.errors import InvalidParameterError

AXES = (("surge", "N"), ("sway", "N"), ("yaw", "N·m"), ("tank_x", "N"), ("tank_y", "N"))

TERMS = (
    ("1", ""),
    ("u", "m/s"),
    ("v", "m/s"),
    ("r", "rad/s"),
    ("u|u|", "m²/s²"),
    ("v|v|", "m²/s²"),
    ("r|r|", "rad²/s²"),
    ("uv", "m²/s²"),
    ("ur", "m rad/s²"),
    ("vr", "m rad/s²"),
    ("u|r|", "m rad/s²"),
    ("v|u|", "m²/s²"),
    ("a", "rad"),
    ("a_dot", "rad/s"),
    ("a|a|", "rad²"),
    ("a_dot|a_dot|", "rad²/s²"),
    ("u a", "m rad/s"),
    ("u a_dot", "m rad/s²"),
    ("t", "s"),
    ("u t", "m"),
    ("r t", "rad"),
    ("x", "m"),
    ("y", "m"),
)
"""Terms with their units; a stands for the tail angle α, t for the time."""

PLACES = {
    f"{axis}:{term}": (row, column)
    for row, (axis, _) in enumerate(AXES)
    for column, (term, _) in enumerate(TERMS)
}
"""Name of a coefficient → its axis and its term."""

LARGEST = 1e6
"""N or N·m per unit of a term: far beyond what any robot survives, and still finite."""


@dataclass(frozen=True, slots=True)
class ExtraForce:
    """Coefficients by name, those that are not zero, in the order of ``PLACES``."""

    SECTION: ClassVar[str] = "force"

    coefficients: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        """Refuse names that there are not, and what is no number."""
        for name, value in self.coefficients:
            check_name(f"{self.SECTION}.{name}", name)
            check_number(f"{self.SECTION}.{name}", value, least=-LARGEST, most=LARGEST)

    @property
    def acting(self) -> bool:
        """Whether there is any force."""
        return any(value != 0.0 for _, value in self.coefficients)


def check_name(path: str, name: str) -> None:
    """Refuse the name of a coefficient that there is not."""
    if name in PLACES:
        return
    axis, _, _ = name.partition(":")
    if axis in {axis for axis, _ in AXES}:
        choice = f"terms are {', '.join(term for term, _ in TERMS)}"
    else:
        choice = f"write {' or '.join(f'{axis}:TERM' for axis, _ in AXES)}"
    raise InvalidParameterError(path, f"there is no such coefficient; {choice}")


def extra_force(**values: float) -> ExtraForce:
    """Return a force with some coefficients by name; those of zero are left out."""
    for name in values:
        check_name(f"{ExtraForce.SECTION}.{name}", name)
    return ExtraForce(
        tuple((name, float(values[name])) for name in PLACES if values.get(name, 0.0) != 0.0)
    )
