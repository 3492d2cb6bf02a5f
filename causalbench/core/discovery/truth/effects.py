"""The size of an effect, T_kj = E[(r_j(s, a) - r_j(s, a with a_k = 0))^2] / Var(r_j), from pairs of rewards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.samples.transitions import varies

Array = NDArray[np.float64]

RULE_OF_THREE = 3.0  # what n states did not show happens in less than 3 / n of them, with 95% confidence
ABSENT_BELOW = 0.005  # upper bound of the interval of an effect
STRONG_ABOVE = 0.05  # lower bound
RESAMPLES = 2000


def effects(
    taken: Array, squares: Array, sequence: NDArray[np.integer[Any]], rng: np.random.Generator, confidence: float
) -> tuple[Array, Array, Array]:
    """E[squares] / Var(taken) with bootstrap bounds, each (n_rows, n_terms); NaN where a term never varies.

    `taken` (n, n_terms) are the rewards of the action itself, `squares` (n, n_rows, n_terms) squared differences from
    it, `sequence` (n,). Whole sequences are resampled, since states of one sequence resemble each other.
    """
    _, group = np.unique(sequence, return_inverse=True)
    n_groups = int(group.max()) + 1

    def total(values: NDArray[Any]) -> Array:
        out = np.zeros((n_groups, *values.shape[1:]))
        np.add.at(out, group, values)
        return out

    testable = varies(taken)
    taken = taken - taken.mean(0)  # so that no digits are lost in a difference of large squares
    least = 1e-12 * taken.var(0)
    count, first, second, square = (
        total(x) for x in (np.ones(len(taken)), taken, taken**2, squares.reshape(len(squares), -1))
    )

    def ratio(weights: Array) -> Array:
        n = weights @ count
        variance = weights @ second / n[:, None] - (weights @ first / n[:, None]) ** 2
        mean_square = (weights @ square / n[:, None]).reshape(len(weights), *squares.shape[1:])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where((variance > least)[:, None] & testable, mean_square / variance[:, None], np.nan)

    effect = ratio(np.ones((1, n_groups)))[0]
    weights = rng.multinomial(n_groups, np.full(n_groups, 1 / n_groups), size=RESAMPLES).astype(np.float64)
    resampled = ratio(weights)
    tail = (1 - confidence) / 2
    low, high = np.full_like(effect, np.nan), np.full_like(effect, np.nan)
    known = ~np.isnan(effect)
    # A resample in which a rare reward never varies says nothing about its effect.
    if known.any():
        low[known], high[known] = np.nanquantile(resampled[:, known], [tail, 1 - tail], axis=0)
    return effect, low, high
