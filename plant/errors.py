"""Errors of the plant: one base, so that a caller can catch what physics refuses and nothing else.

Each concrete error also inherits the builtin that says what kind of mistake it is.
"""


class PlantError(Exception):
    """Base of everything that this package raises on purpose."""


class InvalidParameterError(PlantError, ValueError):
    """A parameter makes no physical sense.

    ``field`` is its dotted name below the plant section (for example ``body.mass_kg``), so that a
    scenario reader can put its own path in front of it.
    """

    def __init__(self, field: str, reason: str) -> None:
        super().__init__(f"{field}: {reason}")
        self.field = field
        self.reason = reason


class DivergedError(PlantError, ArithmeticError):
    """The state left every physical bound, or became not-a-number.

    ``time_s`` and ``state`` belong to the last grid point where all was well; ``cause`` is the
    likely reason in words.
    """

    def __init__(self, time_s: float, state: tuple[float, ...], cause: str) -> None:
        named = ", ".join(
            f"{name} {value:.4g}"
            for name, value in zip(
                ("x", "y", "heading", "u", "v", "r", "tail", "tail rate"), state, strict=False
            )
        )
        when = f"after {time_s:.6g} s" if time_s > 0.0 else "in its first step"
        super().__init__(f"the motion diverged {when} ({named}): {cause}")
        self.time_s = time_s
        self.state = state
        self.cause = cause


class NoOrbitError(PlantError, ArithmeticError):
    """No steady motion of a tail beat was found; ``reason`` says why, ``closure`` how nearly.

    ``closure``: how far from closed the best beat was, as a share of the speeds of the motion.
    """

    def __init__(self, reason: str, closure: float) -> None:
        super().__init__(f"no steady motion found: {reason}")
        self.reason = reason
        self.closure = closure


class LookBackError(PlantError, ValueError):
    """A look, or an input, at a time that the plant has already left behind."""
