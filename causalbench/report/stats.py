"""Statistics over seeds, by scipy where it has them, and seeded.

rliable's bootstrap ignores the random state it is given; its point estimates are what these functions return (tests
compare them). "Runs" are seeds; a stratum is a backend, resampled on its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.stats
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interval = tuple[float, float]

LEAST_SEEDS = 5
"""Fewer seeds give no interval: a percentile bootstrap of four numbers claims far more than they say."""
RESAMPLES = 2_000
ALPHA = 0.05


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


def pooled_iqm(strata: Sequence[Array]) -> Array:
    """`iqm` of all runs of all strata together."""
    return iqm(np.concatenate(strata, axis=-1))


def mean_probability_better(x: Sequence[Array], y: Sequence[Array]) -> Array:
    """`probability_better` within each stratum, averaged over strata."""
    mean: Array = np.mean([probability_better(a, b) for a, b in zip(x, y, strict=True)], axis=0)
    return mean


def resample(strata: Sequence[Array], rng: np.random.Generator) -> list[Array]:
    """`RESAMPLES` bootstrap samples of each stratum: (n,) becomes (RESAMPLES, n)."""
    return [values[rng.integers(len(values), size=(RESAMPLES, len(values)))] for values in strata]


def interval(samples: Array, alpha: float = ALPHA) -> Interval:
    """Percentile interval that leaves out a share `alpha`."""
    low, high = np.quantile(samples, [alpha / 2, 1 - alpha / 2])
    return float(low), float(high)


def bootstrap_interval(statistic: Callable[[list[Array]], Array], strata: Sequence[Array], seed: int = 0) -> Interval:
    """Percentile interval of `statistic` under resampling of the runs of each stratum."""
    found = scipy.stats.bootstrap(
        strata,
        lambda *samples, axis: statistic(list(samples)),
        n_resamples=RESAMPLES,
        vectorized=True,
        confidence_level=1 - ALPHA,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return float(found.low), float(found.high)


@dataclass(frozen=True)
class Comparison:
    """One method against the next one below it. `bounds` are Holm-corrected; `separated` if they exclude one half."""

    probability: float
    bounds: Interval
    separated: bool


def compare_neighbours(ordered: Sequence[Sequence[Array]], seed: int = 0) -> list[Comparison]:
    """Each method, best first and given as its strata, against the next one; Holm's step-down over all pairs.

    The pair with the smallest bootstrap p-value gets an interval of level 1 - alpha / pairs, the next one
    1 - alpha / (pairs - 1), and so on; after the first that does not exclude one half, none is separated.
    """
    rng = np.random.default_rng(seed)
    pairs = list(pairwise(ordered))
    samples = [mean_probability_better(resample(x, rng), resample(y, rng)) for x, y in pairs]
    p_values = [2 * min((s <= 0.5).mean(), (s >= 0.5).mean()) for s in samples]
    found: dict[int, Comparison] = {}
    still = True
    for position, index in enumerate(sorted(range(len(pairs)), key=lambda i: p_values[i])):
        low, high = interval(samples[index], ALPHA / (len(pairs) - position))
        still = still and not low <= 0.5 <= high
        found[index] = Comparison(float(mean_probability_better(*pairs[index])), (low, high), still)
    return [found[index] for index in range(len(pairs))]


def shared_ranks(separated: Sequence[bool]) -> list[int]:
    """Ranks of a best-first list in which `separated[i]` says whether item i stands apart from item i + 1."""
    ranks = [1]
    for position, apart in enumerate(separated, start=2):
        ranks.append(position if apart else ranks[-1])
    return ranks
