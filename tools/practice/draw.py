"""What a seed hides: nothing, one effect, two, or one that is in no table; and how strongly.

The strength is λ, the expected gain in twice the log-likelihood of a model that knows the effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tools.practice.experiment import Effect, shape_of, stream
from tools.practice.hidden import HIDDEN, LISTED, UNLISTED
from tools.practice.strength import sized

KINDS = (("none", 0.2), ("one", 0.5), ("two", 0.15), ("unlisted", 0.15))
"""What an experiment may hide, and how often."""

WEAKEST, STRONGEST = 60.0, 400.0
TWO_LEAST = 150.0


@dataclass(frozen=True, slots=True)
class Secret:
    """What an experiment hides."""

    kind: str
    names: tuple[str, ...]
    strength: float


def secret(seed: int) -> Secret:
    """Draw what the experiment of a seed hides."""
    draw = stream(seed, 9)
    kind = str(draw.choice([name for name, _ in KINDS], p=[share for _, share in KINDS]))
    strength = math.exp(draw.uniform(math.log(WEAKEST), math.log(STRONGEST)))
    if kind == "none":
        return Secret(kind, (), 0.0)
    if kind == "two":
        names = tuple(str(name) for name in draw.choice(LISTED, 2, replace=False))
        return Secret(kind, names, max(strength, TWO_LEAST))
    table = LISTED if kind == "one" else UNLISTED
    return Secret(kind, (str(draw.choice(table)),), strength)


def effects(seed: int, hidden: Secret) -> tuple[Effect, ...]:
    """Return the effects in the sizes that give each its strength, or the largest credible one."""
    return tuple(
        Effect(name, sized(seed, name, hidden.strength)[0], shape_of(name, seed))
        for name in hidden.names
        if name in HIDDEN
    )
