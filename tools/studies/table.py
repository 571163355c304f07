"""The table of studies: a published figure or table is one function and one row here.

A row names its function as "module:function"; the module is imported when the study runs, so that
the table can be listed without NumPy or Numba. The function takes a `Progress` and returns a
`Result` (`tools.studies.study`). Rows stand in the order of the source.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tools.studies.study import Study


@dataclass(frozen=True, slots=True)
class Row:
    """One study: its name, what it shows in a line, and where its function is."""

    name: str
    description: str
    function: str

    def load(self) -> Study:
        """Import the function."""
        from tools.studies.study import Study

        module, _, name = self.function.partition(":")
        return Study(self.name, self.description, getattr(importlib.import_module(module), name))


def _rows(module: str, *rows: tuple[str, str, str]) -> tuple[Row, ...]:
    return tuple(
        Row(name, description, f"tools.studies.{module}:{function}")
        for name, function, description in rows
    )


STUDIES: tuple[Row, ...] = (
    *_rows(
        "chapter3_drag",
        ("table-3.1", "added_mass", "added mass and inertia of the spheroid"),
        ("table-3.2", "table_3_2", "drag identified at three biases, and the laws fitted to it"),
    ),
    *_rows(
        "chapter3_turning",
        ("fig-3.4", "over_bias", "turning radius and period over the bias"),
        ("fig-3.5", "over_amplitude", "turning radius and period over the amplitude"),
        ("fig-3.6", "over_frequency", "turning radius and period over the frequency"),
    ),
    *_rows(
        "chapter3_forward",
        ("fig-3.7", "thrust", "thrust with and without the body's motion"),
        ("fig-3.8", "speed", "speed with and without the body's motion"),
    ),
    *_rows(
        "chapter3_turning",
        ("fig-3.9", "mean_beta", "mean angle of attack over bias, amplitude and frequency"),
        ("fig-3.10", "adapted", "turning with drag adapted to the bias"),
    ),
    *_rows("chapter3_forward", ("fig-3.11", "transient", "swimming forward from rest")),
    *_rows(
        "chapter3_lift",
        ("fig-3.12", "surrogate", "turning with lift from the bias, constant drag"),
        ("fig-3.13", "surrogate_adapted", "turning with lift from the bias, adapted drag"),
    ),
    *_rows(
        "chapter4_tail",
        ("fig-4.7", "tip", "displacement of the tail's tip for three, four and five segments"),
        ("fig-4.8", "cost", "processor time over the number of segments (a measurement)"),
    ),
    *_rows(
        "chapter4_speed",
        ("fig-4.9", "over_frequency", "speed over frequency with a flexible tail, two models"),
        ("fig-4.10", "over_frequency_long", "speed over frequency with the longer flexible tail"),
        ("fig-4.11", "transient", "swimming forward from rest with a flexible tail"),
    ),
    *_rows(
        "chapter4_tail",
        ("fig-4.13", "shapes_slow", "shapes of the flexible tail over half a beat at 0.4 Hz"),
        ("fig-4.14", "shapes_fast", "shapes of the flexible tail over half a beat at 0.9 Hz"),
    ),
    *_rows(
        "chapter5_average",
        ("fig-5.1", "averaging", "classical and first-order averages of the original dynamics"),
        ("fig-5.2", "trajectory", "path of the original dynamics"),
        ("fig-5.3", "heading", "heading of the original dynamics"),
    ),
    *_rows(
        "chapter5_scaling",
        ("fig-5.4", "bias_and_amplitude", "scaling of the forces over bias and amplitude"),
        ("fig-5.5", "bias_and_frequency", "scaling of the forces over bias and frequency"),
        ("fig-5.6", "amplitude_and_frequency", "scaling of the forces over amplitude, frequency"),
        ("table-5.1", "table_5_1", "scaling found by search over 125 beats"),
    ),
    *_rows(
        "chapter5_average",
        ("fig-5.7", "over_bias", "average model against the original over the bias"),
        ("table-5.2", "surge", "speed straight ahead of the original and the average model"),
    ),
    *_rows(
        "chapter5_scaling",
        ("table-5.3", "table_5_3", "scaling found for a robot of twice the mass"),
    ),
    *_rows(
        "chapter5_average",
        ("fig-5.8", "heavy_over_bias", "average model of the heavy robot over the bias"),
        ("fig-5.9", "heavy_over_amplitude", "average model of the heavy robot over the amplitude"),
    ),
    *_rows(
        "chapter5_control",
        ("fig-5.10", "fig_5_10", "proportional control, and the average model with its bias"),
    ),
    *_rows(
        "chapter5_average",
        ("fig-5.11", "forward", "time for 50 cm over the frequency"),
        ("fig-5.12", "from_rest", "average model from rest"),
    ),
    *_rows(
        "chapter5_turning",
        ("fig-5.14", "over_bias", "steady turning by algebra over the bias"),
        ("fig-5.15", "over_frequency", "steady turning by algebra over the frequency"),
        ("fig-5.16", "over_amplitude", "steady turning by algebra over the amplitude"),
    ),
    *_rows(
        "chapter5_control",
        ("fig-5.19", "fig_5_19", "target tracking from different starts, and from a grid of poses"),
        ("fig-5.21", "fig_5_21", "target tracking, several targets one after the other"),
    ),
    *_rows(
        "chapter6_sampling",
        ("fig-6.4", "the_field", "water temperature of a heated tank as a matrix of rank 6"),
        ("fig-6.5", "random_completion", "half of the field at random, completed by Algorithm 1"),
        ("fig-6.6", "successive", "the field by successive expansion, Algorithm 2"),
        ("fig-6.9", "the_late_field", "a field whose corner has a smaller rank"),
        ("fig-6.10", "defeated", "Algorithm 2 on the field whose corner has a smaller rank"),
        ("fig-6.11", "recovered", "Algorithm 3 on the field whose corner has a smaller rank"),
        ("fig-6.12", "extra_samples", "where Algorithm 3 samples besides"),
    ),
    *_rows(
        "chapter6_travel",
        ("fig-6.7", "salesmen", "two salesmen visit random samples by a genetic algorithm"),
        ("fig-6.8", "expansion", "two robots walk the samples of an expanding area"),
    ),
)
