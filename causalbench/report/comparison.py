"""Two methods compared on their seeds, within each backend; backends weigh alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from causalbench.report.permutation import TOLERANCE, Array, Shifts, Size, least_p, regroup
from causalbench.report.stats import ALPHA

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
    paired = bool(pairs_pay(left, right))
    least = least_p([_size(a, b, paired) for a, b in zip(left, right, strict=True)])
    level = ALPHA / comparisons
    detectable = detectable_difference(left, right, paired, level) if least <= level else None
    known = None if np.isnan(correlation) else float(correlation)
    return Comparison(regroup(left, right, paired).shifts(), paired, known, least, detectable)


def _size(left: Array, right: Array, paired: bool) -> Size:
    return len(left), len(right), paired


def pairs_pay(left: Sequence[Array], right: Sequence[Array]) -> NDArray[np.bool_]:
    """Whether seeds are taken as pairs; arrays of (..., n) give (...)."""
    enough = all(a.shape[-1] == b.shape[-1] >= LEAST_PAIRS for a, b in zip(left, right, strict=True))
    correlation = seed_correlation(left, right)
    pay: NDArray[np.bool_] = (correlation >= LEAST_CORRELATION) & enough  # NaN is not
    return pay


def seed_correlation(left: Sequence[Array], right: Sequence[Array]) -> Array:
    """Pearson's correlation over seeds, the mean of backends where there is one; NaN unless there are three pairs."""
    if not all(a.shape[-1] == b.shape[-1] > 2 for a, b in zip(left, right, strict=True)):
        return np.full(left[0].shape[:-1], np.nan)
    each = np.array([_correlation(a, b) for a, b in zip(left, right, strict=True)])
    found = np.isfinite(each)
    with np.errstate(invalid="ignore"):
        mean: Array = np.where(found, each, 0.0).sum(axis=0) / found.sum(axis=0)
    return mean


def _correlation(left: Array, right: Array) -> Array:
    """NaN where one of them does not vary."""
    a, b = left - left.mean(axis=-1, keepdims=True), right - right.mean(axis=-1, keepdims=True)
    scale = np.sqrt((a**2).sum(axis=-1) * (b**2).sum(axis=-1))
    found: Array = np.where(scale > TOLERANCE, (a * b).sum(axis=-1) / np.maximum(scale, TOLERANCE), np.nan)
    return found


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
