"""Numbers that make sense: bounds declared beside a field, checked at construction."""

import math
from dataclasses import field, fields
from typing import Any, ClassVar

from plant.errors import InvalidParameterError


def check_number(
    name: str,
    value: object,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    because: str = "",
) -> None:
    """Refuse what is no finite number in (above, ∞) ∩ [least, most], and say what is allowed."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InvalidParameterError(name, f"must be a number, got {value!r}")
    if not math.isfinite(value):
        raise InvalidParameterError(name, f"must be finite, got {value!r}")
    if value > above and least <= value <= most:
        return
    limits = []
    if above > -math.inf:
        limits.append(f"above {above:g}")
    if least > -math.inf:
        limits.append(f"at least {least:g}")
    if most < math.inf:
        limits.append(f"at most {most:g}")
    reason = f"must be {' and '.join(limits)}, got {value!r}"
    raise InvalidParameterError(name, f"{reason} ({because})" if because else reason)


class Checked:
    """Base of a section: every numeric field is checked against the bounds in its metadata."""

    __slots__ = ()
    SECTION: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for item in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            if item.metadata:
                check_number(
                    f"{self.SECTION}.{item.name}", getattr(self, item.name), **item.metadata
                )


def number(default: float, **bounds: Any) -> Any:
    """Declare a numeric field with its default and the bounds that ``check_number`` takes."""
    return field(default=default, metadata=bounds or {"least": -math.inf})
