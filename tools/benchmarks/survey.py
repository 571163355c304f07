"""Reconstruction by successive expansion against completion by Algorithm 1, in one process.

The source: 0.04 s against 0.4 s of processor time for the field of Fig. 6.4, in Matlab. Here both
take turns on the same field; the whole survey is timed, with every question and every answer.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from procboard.survey.completion import complete
from procboard.survey.successive import algorithm_2
from procboard.survey.tolerant import noise_tolerant
from tools.benchmarks.measure import Effort, Figures, Row, best_s
from tools.studies.chapter6_sampling import RANK, SEED, random_half, swim, temperature

NOISE = 1.0  # of 255, for the noise-tolerant survey


def reconstruction(effort: Effort) -> Figures:
    """Processor time of Algorithm 1 with half of the cells, of Algorithm 2, and with noise."""
    field = temperature()
    mask = random_half((24, 24), SEED)
    noisy = field + NOISE * np.random.default_rng(SEED).standard_normal((24, 24))

    def expand() -> None:
        survey = algorithm_2((24, 24), RANK)
        swim(survey, field)
        survey.reconstruction()

    def tolerate() -> None:
        survey = noise_tolerant((24, 24), NOISE)
        swim(survey, noisy)
        survey.reconstruction()

    completed, expanded, tolerated = best_s(
        effort.repeats,
        lambda: complete(field, mask),
        expand,
        tolerate,
        clock=time.thread_time,
    )
    return {"complete_s": completed, "expand_s": expanded, "tolerate_s": tolerated}


def reconstruction_rows(figures: Figures) -> Sequence[Row]:
    """Each, and how many times as fast as Algorithm 1."""
    completed = figures["complete_s"]
    return [
        Row("24 × 24, rank 6: Algorithm 1, half of the cells", f"{1e3 * completed:.1f} ms"),
        Row(
            "  Algorithm 2, 43.75 % of the cells",
            f"{1e3 * figures['expand_s']:.1f} ms",
            "≥ 10 × as fast",
            f"{completed / figures['expand_s']:.0f} × as fast",
        ),
        Row(
            "  noise-tolerant",
            f"{1e3 * figures['tolerate_s']:.1f} ms",
            "",
            f"{completed / figures['tolerate_s']:.0f} × as fast",
        ),
    ]
