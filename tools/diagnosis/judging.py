"""What candidates gain in twice the log-likelihood, by the residuals where they were screened.

The score test assumes that what is left is white. It is made robust by a sandwich (Huber 1967,
White 1982; by blocks of time, in the spirit of Newey and West 1987): with scores w_b of blocks, the
variance Σ (w_b − mean)² replaces the information where it is larger; short blocks and longer ones
are taken, whichever is larger. A variance of few blocks says little: where most of the information
is in ν of them it is moderated towards the information's own (Smyth 2004). Gains of candidates with
different numbers of parameters are put on one scale: the one-parameter gain with the same χ²
probability.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri_exp
from scipy.stats import chi2

from tools.diagnosis.evidence import Nuisances, Point, prior_pull, project, pulled
from tools.diagnosis.model import FloatArray, IntArray
from tools.diagnosis.screening import Candidate, Screen, block_information

MOST_INFLATION = 4.0
"""The sandwich reduces gains by no more: what inflates it further is an effect, not noise."""


PRIOR_BLOCKS = 8.0
"""The information's own variance counts as that of so many blocks."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Per candidate: ``gain`` in twice the log-likelihood, ``robust`` on the one-parameter scale.

    ``sizes`` per candidate multiplies the steps of its columns. ``inflation`` is the sandwich's
    factor per column. ``by_owner`` is the best robust
    gain of each owner, ``plain`` its best gain on that scale without the sandwich. ``families``:
    robust gain of each family.
    """

    gain: FloatArray
    robust: FloatArray
    sizes: tuple[FloatArray, ...]
    inflation: FloatArray
    by_owner: FloatArray
    plain: FloatArray
    families: FloatArray


def one_parameter_scale(gain: FloatArray, parameters: int) -> FloatArray:
    """Return the χ²₁ value that is as improbable as ``gain`` is under χ² of so many parameters."""
    if parameters == 1:
        return gain
    log_p = chi2.logsf(np.maximum(gain, 0.0), parameters)
    found: FloatArray = np.minimum(np.square(ndtri_exp(log_p - math.log(2.0))), gain)
    return found


def judge_many(screen: Screen, scores: FloatArray, blocks: FloatArray) -> FloatArray:
    """Return robust gains (sets, owners) of scores (sets, columns) and (sets, blocks, columns)."""
    robust = _robust(screen, screen.candidates, scores, _inflation(screen, scores, blocks))[1]
    index = {owner: i for i, owner in enumerate(screen.owners)}
    found = np.zeros((scores.shape[0], len(screen.owners)))
    for i, candidate in enumerate(screen.candidates):
        owner = index[candidate.owner]
        np.maximum(found[:, owner], robust[:, i], out=found[:, owner])
    return found


def judge_families(screen: Screen, scores: FloatArray, blocks: FloatArray) -> FloatArray:
    """Return robust gains (sets, families) of scores as of ``judge_many``."""
    return _robust(screen, screen.families, scores, _inflation(screen, scores, blocks))[1]


def inflation(
    screen: Screen,
    given: Nuisances,
    columns_: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
) -> float:
    """Return the sandwich's factor at a refit, whose sensitivities these are (per run (n, c)).

    There the scores of blocks add up to nothing, so they need not be centred; and an effect that
    acts now and then is not taken for noise that does.
    """
    projection = project(given, columns_)
    information = np.maximum(np.diag(projection.information), 1e-300)
    blocks = _by_block(projection.columns, residuals, screen.first_rows)
    told = block_information(projection.columns, screen.first_rows)
    factor = _moderated(blocks[None], told, screen.groups, projection.prior, information)
    return float(np.mean(factor))


def _moderated(
    blocks: FloatArray,
    told: FloatArray,
    groups: Sequence[IntArray],
    prior: FloatArray,
    information: FloatArray,
) -> FloatArray:
    """Return the sandwich's factors (sets, columns) of scores (sets, blocks, columns).

    ``told``: each block's part of the information (blocks, columns). The larger factor, of blocks
    or of their groups.
    """
    factor = np.ones((blocks.shape[0], blocks.shape[2]))
    for rows in groups:
        grouped = np.add.reduceat(blocks, rows, axis=1)
        own = np.add.reduceat(told, rows, axis=0)
        total = own.sum(axis=0)
        effective = total**2 / np.maximum(np.sum(own**2, axis=0), 1e-300)
        count = max(grouped.shape[1], 2)
        spread = np.einsum("sbc,sbc->sc", grouped, grouped) * (count / (count - 1.0))
        found = np.clip((spread + np.diag(prior)) / information, 1.0, MOST_INFLATION)
        share = effective / (effective + PRIOR_BLOCKS)
        factor = np.maximum(factor, 1.0 + share * (found - 1.0))
    return factor


def _inflation(screen: Screen, scores: FloatArray, blocks: FloatArray) -> FloatArray:
    """Return the sandwich's factors (sets, columns) of scores, and of those of blocks."""
    information = np.maximum(np.diag(screen.projection.information), 1e-300)
    alone = scores / information
    centred = blocks - alone[:, None, :] * screen.block_information[None]
    told, prior = screen.block_information, screen.projection.prior
    return _moderated(centred, told, screen.groups, prior, information)


def _robust(
    screen: Screen, candidates: Sequence[Candidate], scores: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Return gains and robust gains (sets, candidates), and per candidate sizes (sets, columns)."""
    gains = np.zeros((scores.shape[0], len(candidates)))
    robust = np.zeros_like(gains)
    sizes = []
    for i, candidate in enumerate(candidates):
        mine = list(candidate.columns)
        if not mine:
            sizes.append(np.zeros((scores.shape[0], 0)))
            continue
        size = scores[:, mine] @ candidate.inverse
        gain = np.einsum("sc,sc->s", scores[:, mine], size)
        allowed = np.all((size >= 0.0) | ~np.array(candidate.positive), axis=1)
        gains[:, i] = np.where(allowed, gain, 0.0)
        inflation = factor[:, mine].mean(axis=1)
        robust[:, i] = one_parameter_scale(gains[:, i] / inflation, candidate.rank)
        sizes.append(size)
    return gains, robust, sizes


def block_scores(screen: Screen, residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the part of the scores that comes from each time block (blocks, columns)."""
    return _by_block(screen.projection.columns, residuals, screen.first_rows)


def _by_block(
    columns_: Sequence[FloatArray], residuals: Sequence[FloatArray], first_rows: Sequence[IntArray]
) -> FloatArray:
    parts = []
    for residual, cleaned, rows in zip(residuals, columns_, first_rows, strict=True):
        edges = [*rows, residual.size]
        parts += [
            -(residual[a:b] @ cleaned[a:b]) for a, b in itertools.pairwise(int(e) for e in edges)
        ]
    return np.array(parts)


def judge(
    screen: Screen, residuals: Sequence[FloatArray], given: Nuisances, point: Point
) -> Judgement:
    """Judge all candidates by the residuals at the point where the screen was built."""
    blocks = block_scores(screen, residuals)
    scores = pulled(screen.projection, *prior_pull(given, point)) + blocks.sum(axis=0)
    factor = _inflation(screen, scores[None], blocks[None])
    gains, robust, sizes = _robust(screen, screen.candidates, scores[None], factor)
    by_owner, plain = np.zeros(len(screen.owners)), np.zeros(len(screen.owners))
    index = {owner: i for i, owner in enumerate(screen.owners)}
    for i, candidate in enumerate(screen.candidates):
        owner = index[candidate.owner]
        by_owner[owner] = max(by_owner[owner], robust[0, i])
        one = one_parameter_scale(gains[:, i], len(candidate.columns))[0]
        plain[owner] = max(plain[owner], one)
    together = _robust(screen, screen.families, scores[None], factor)[1][0]
    each = tuple(size[0] for size in sizes)
    return Judgement(gains[0], robust[0], each, factor[0], by_owner, plain, together)
