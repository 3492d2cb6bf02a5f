"""Descriptions of seeds: point estimates as rliable has them (tests compare them), and intervals that are exact.

"Runs" are seeds; a stratum is a backend. What tests a difference stands in `permutation.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.stats
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interval = tuple[float, float]

ALPHA = 0.05
"""The level of every test and of every interval, which is then of 95%."""


def wilson(successes: int, n: int) -> Interval:
    """95% Wilson score interval of the share `successes` / `n`."""
    found = scipy.stats.binomtest(successes, n).proportion_ci(1 - ALPHA, "wilson")
    return float(found.low), float(found.high)


def area_under(steps: Sequence[float], values: Sequence[float], budget: float) -> float:
    """Trapezoid area under `values` at `steps`, from 0 at step 0, divided by `budget`."""
    x, y = np.array([0.0, *steps]), np.array([0.0, *values])
    return float(((y[1:] + y[:-1]) / 2 * np.diff(x)).sum() / budget)


def iqm(values: Array) -> Array:
    """Mean of the middle half along the last axis: a quarter of the values, rounded down, is cut at each end."""
    middle: Array = scipy.stats.trim_mean(values, 0.25, axis=-1)
    return middle


def probability_better(x: Array, y: Array) -> Array:
    """P(X > Y) + P(X = Y) / 2 over all pairs of runs; x (..., n) and y (..., m)."""
    better: Array = (np.sign(x[..., :, None] - y[..., None, :]).mean(axis=(-2, -1)) + 1) / 2
    return better


def mean_iqm(strata: Sequence[Array]) -> float:
    """`iqm` within each stratum, averaged over strata."""
    return float(np.mean([iqm(values) for values in strata]))


def mean_probability_better(x: Sequence[Array], y: Sequence[Array]) -> float:
    """`probability_better` within each stratum, averaged over strata."""
    return float(np.mean([probability_better(a, b) for a, b in zip(x, y, strict=True)]))


def median_interval(values: Array) -> tuple[Array, Array]:
    """Exact 95% interval of the median along the last axis, by order statistics; NaN for fewer than six values."""
    n = values.shape[-1]
    outside = int(scipy.stats.binom.ppf(ALPHA / 2, n, 0.5)) - 1  # values below it that may lie above the median
    if outside < 0:
        return np.full(values.shape[:-1], np.nan), np.full(values.shape[:-1], np.nan)
    ordered = np.sort(values, axis=-1)
    return ordered[..., outside], ordered[..., n - 1 - outside]


def tolerance(n: int) -> float:
    """The share of all runs that lies, with 95% confidence, between the lowest and the highest of `n`."""
    return float(scipy.stats.beta.ppf(ALPHA, n - 1, 2)) if n > 1 else 0.0
