"""Clocks and links: times that run fast or slow, commands that are lost."""

from tools.diagnosis.fish.setup import Row, added
from tools.diagnosis.model import Cause, Parameter

ROWS = (
    Row(
        Cause(
            "clock_drift",
            "the recorder's clock runs fast or slow",
            (Parameter("clock_drift.k", "", -0.2, 0.2, scale=2e-4),),
            "The clock that stamped the records shows (1 {k:+.5f}) s for every true second.",
        ),
        added(k="clock_drift"),
    ),
    Row(
        Cause(
            "dropped_commands",
            "some tail-beat commands never arrive",
            (Parameter("dropped_commands.p", "", 0.0, 0.9, scale=0.2),),
            "Some commands never reach the tail: about {p:.0%} of them are lost.",
        ),
        added(p="dropped"),
    ),
)
