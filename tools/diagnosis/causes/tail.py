"""The tail fin: bent, broken, or with the body's own motion left out of its forces."""

from tools.diagnosis.fish.setup import Row, physical
from tools.diagnosis.model import Cause, Parameter

ROWS = (
    Row(
        Cause(
            "tail_flexibility",
            "the tail bends",
            (
                Parameter(
                    "tail_flexibility.compliance_rad_n_m", "rad/(N·m)", 0.0, 1000.0, scale=5.0
                ),
            ),
            "The tail is not rigid but bends: each of five joints along it gives way by "
            "{compliance_rad_n_m:.3g} rad for each N·m.",
            costly=True,
        ),
        physical("tail_flexibility"),
    ),
    Row(
        Cause(
            "fin_damage",
            "a part of the tail's depth is missing",
            (Parameter("fin_damage.k", "", 0.0, 0.9, scale=0.02),),
            "The tail fin is damaged: it has lost {k:.1%} of its depth.",
        ),
        physical("fin_damage"),
    ),
    Row(
        Cause(
            "tail_body_coupling",
            "the share of the body's motion that the tail's forces feel is another",
            (Parameter("tail_body_coupling.k", "", -1.0, 1.0, scale=0.05),),
            "The tail's forces feel the body's own motion by a share that differs by {k:+.3f} "
            "from what the model says.",
        ),
        physical("tail_body_coupling"),
    ),
)
