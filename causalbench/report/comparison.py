"""Two methods compared on their seeds, within each backend; backends weigh alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats

from causalbench.report.permutation import Array, Shifts, Size, least_p, regroup

ALPHA = 0.05
POWER = 0.8
LEAST_CORRELATION = 0.5
"""From here on pairs halve the variance of a difference."""
LEAST_PAIRS = 8
"""Fewer seeds say little about their correlation, and leave 2^n regroupings where there are (2n choose n)."""


@dataclass(frozen=True)
class Comparison:
    """What the seeds say of two methods.

    `correlation` is that of the two methods' values by seed, the mean over backends, None where it is undefined.
    `least_p` is the smallest p-value that so many seeds can give, `detectable` the true difference that they would
    show with a chance of 80%, None where they cannot show any.
    """

    shifts: Shifts
    paired: bool
    correlation: float | None
    least_p: float
    detectable: float | None


def compare(left: Sequence[Array], right: Sequence[Array], comparisons: int = 1) -> Comparison:
    """Compare two methods, one array of seeds per backend and in the same order; one of so many `comparisons`.

    Seeds are pairs only where that pays: from 8 seeds on, of a correlation of at least 0.5.
    """
    correlation = seed_correlation(left, right)
    enough = all(len(a) == len(b) >= LEAST_PAIRS for a, b in zip(left, right, strict=True))
    paired = enough and correlation is not None and correlation >= LEAST_CORRELATION
    least = least_p([_size(a, b, paired) for a, b in zip(left, right, strict=True)])
    level = ALPHA / comparisons
    detectable = detectable_difference(left, right, paired, level) if least <= level else None
    return Comparison(regroup(left, right, paired).shifts(), paired, correlation, least, detectable)


def _size(left: Array, right: Array, paired: bool) -> Size:
    return len(left), len(right), paired


def seed_correlation(left: Sequence[Array], right: Sequence[Array]) -> float | None:
    """Pearson's correlation over seeds, the mean over backends; None unless there are pairs that vary."""
    pairs = [(a, b) for a, b in zip(left, right, strict=True) if len(a) == len(b) > 2 and np.ptp(a) and np.ptp(b)]
    if not pairs:
        return None
    return float(np.mean([scipy.stats.pearsonr(a, b).statistic for a, b in pairs]))


def detectable_difference(left: Sequence[Array], right: Sequence[Array], paired: bool, level: float) -> float:
    """The true difference that a two-sided t-test of `level` finds with a chance of 80%, at the spread of the seeds."""
    variances, freedom = 0.0, 0
    for a, b in zip(left, right, strict=True):
        variances += (a - b).var(ddof=1) / len(a) if paired else a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b)
        freedom += len(a) - 1 if paired else len(a) + len(b) - 2
    quantiles = scipy.stats.t.ppf(1 - level / 2, freedom) + scipy.stats.t.ppf(POWER, freedom)
    return float(quantiles * math.sqrt(variances) / len(left))


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Holm's adjusted p-values. None, a comparison that cannot be made, counts as one and stays None."""
    adjusted: list[float | None] = [None] * len(p_values)
    largest = 0.0
    known = sorted((p, index) for index, p in enumerate(p_values) if p is not None)
    for position, (p, index) in enumerate(known):
        largest = max(largest, min(1.0, p * (len(p_values) - position)))
        adjusted[index] = largest
    return adjusted


def log_rank_scores(steps: Sequence[Sequence[float | None]]) -> list[Array]:
    """Per group the log-rank scores of its runs, pooled: those of earlier arrivals are larger, and all sum to zero.

    A score is 1 for a run that got there, None being one that never did within the budget that all share, less the
    Nelson-Aalen hazard up to its time. Differences of their means are the log-rank statistic but for its scale.
    """
    times = np.array([math.inf if step is None else step for group in steps for step in group])
    arrived = np.isfinite(times)
    at_risk = (times[None, :] >= times[:, None]).sum(axis=1)
    jumps = np.where(arrived, 1 / at_risk, 0.0)
    hazards = ((times[None, :] <= times[:, None]) * jumps).sum(axis=1)
    scores = arrived - hazards
    return np.split(scores, np.cumsum([len(group) for group in steps])[:-1])
