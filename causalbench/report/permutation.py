"""Exact tests of a difference of means: seeds are regrouped in every way that chance could have, within each backend.

A regrouping gives each seed a weight, 1/n for the left method and -1/m for the right one; the weighted sum of the
values is the difference that this regrouping shows. A shift of all left values moves it by `reach` times the shift, so
that one list of numbers holds the test of every shift, and the interval is what that test does not refute. Values may
have leading dimensions, each a data set of its own.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

Array = NDArray[np.float64]
Size = tuple[int, int, bool]
"""A stratum: seeds of the left method, of the right one, and whether they are pairs."""

MAX_EXACT = 200_000
"""More regroupings than this are drawn: 10 seeds against 10 have 184,756."""
DRAWS = 20_000
SEED = 0
TOLERANCE = 1e-9
"""Differences that are closer than this are equal: sums in another order differ in their last digits."""


def regroupings(sizes: Sequence[Size]) -> int:
    """How many there are of strata of these sizes."""
    return int(np.prod([2.0**n if paired else comb(n + m, n, exact=True) for n, m, paired in sizes]))


def least_p(sizes: Sequence[Size]) -> float:
    """The smallest two-sided p-value that seeds of these sizes can give, however far apart they lie."""
    total = regroupings(sizes)
    return min(1.0, 2 / total) if total <= MAX_EXACT else 2 / (DRAWS + 1)


@dataclass(frozen=True)
class Regrouped:
    """The differences of all regroupings, (..., N), the observed one first, and the reach of each, (N,)."""

    differences: Array
    reach: Array

    @property
    def two_sided(self) -> Array:
        """Two-sided p-values of no difference (...): twice the smaller one-sided one, at most 1."""
        observed = self.differences[..., :1]
        greater = (self.differences >= observed - TOLERANCE).mean(axis=-1)
        less = (self.differences <= observed + TOLERANCE).mean(axis=-1)
        both: Array = np.minimum(1.0, 2 * np.minimum(greater, less))
        return both

    def shifts(self) -> Shifts:
        """What one data set says of every shift."""
        difference = self.differences[0]
        moved = self.reach < 1 - TOLERANCE
        found = (difference - self.differences[moved]) / (1 - self.reach[moved])
        return Shifts(float(difference), np.sort(found), int(np.sum(~moved)))


@dataclass(frozen=True)
class Shifts:
    """The observed difference, and the sorted shifts at which each regrouping shows as large a difference as is seen.

    `same` counts the regroupings that are the observed one.
    """

    difference: float
    sorted: Array
    same: int

    @property
    def total(self) -> int:
        """All regroupings."""
        return self.same + len(self.sorted)

    def p_greater(self, shift: float = 0.0) -> float:
        """One-sided p-value of the null hypothesis that the true difference is `shift` or less."""
        return (self.same + int(np.searchsorted(self.sorted, shift + TOLERANCE, "right"))) / self.total

    def p_less(self, shift: float = 0.0) -> float:
        """One-sided p-value of the null hypothesis that the true difference is `shift` or more."""
        return (self.total - int(np.searchsorted(self.sorted, shift - TOLERANCE, "left"))) / self.total

    def two_sided(self, within: float = 0.0) -> float:
        """p-value of a true difference of `within` at most, in either direction; of none by default."""
        return min(1.0, 2 * min(self.p_greater(within), self.p_less(-within)))

    def equivalence(self, within: float) -> float:
        """p-value of the two one-sided tests: of a true difference of `within` or more, in either direction."""
        return max(self.p_less(within), self.p_greater(-within))

    def interval(self, alpha: float) -> tuple[float, float] | None:
        """The shifts that two one-sided tests of level `alpha` / 2 do not refute; None where these refute none."""
        needed = int(np.floor(alpha / 2 * self.total + TOLERANCE)) - self.same
        if needed < 0 or not len(self.sorted):
            return None
        return float(self.sorted[needed]), float(self.sorted[-1 - needed])


def regroup(
    left: Sequence[Array], right: Sequence[Array], paired: bool = False, most: int = MAX_EXACT, draws: int = DRAWS
) -> Regrouped:
    """All regroupings of the strata of two methods, (..., n) and (..., m) each, alike in weight.

    Beyond `most` of them `draws` are drawn at random, which with the observed one hold the level just as well.
    """
    sizes = tuple((a.shape[-1], b.shape[-1], paired) for a, b in zip(left, right, strict=True))
    values = [np.concatenate([a, b], axis=-1) for a, b in zip(left, right, strict=True)]
    exact = regroupings(sizes) <= most
    weights = [exact_weights(size) for size in sizes] if exact else drawn_weights(sizes, draws)
    differences = [value @ weight.T for value, weight in zip(values, weights, strict=True)]
    reaches = [weight[:, :n].sum(axis=1) for weight, (n, _, _) in zip(weights, sizes, strict=True)]
    combine = _every_combination if exact else _one_by_one
    return Regrouped(combine(differences), combine(reaches))


def _every_combination(parts: Sequence[Array]) -> Array:
    total = parts[0]
    for part in parts[1:]:
        total = (total[..., :, None] + part[..., None, :]).reshape(*part.shape[:-1], -1)
    return total / len(parts)


def _one_by_one(parts: Sequence[Array]) -> Array:
    mean: Array = np.mean(parts, axis=0)
    return mean


@functools.lru_cache(maxsize=16)
def exact_weights(size: Size) -> Array:
    """The weights of every regrouping of one stratum, (N, n + m), the observed one first."""
    n, m, paired = size
    if paired:
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=n)))
        return np.concatenate([signs, -signs], axis=1) / n
    chosen = np.array(list(itertools.combinations(range(n + m), n)))
    left = np.zeros((len(chosen), n + m), dtype=bool)
    left[np.arange(len(chosen))[:, None], chosen] = True
    return np.where(left, 1 / n, -1 / m)


@functools.lru_cache(maxsize=4)
def drawn_weights(sizes: tuple[Size, ...], draws: int) -> list[Array]:
    """The same for strata together, `draws` + 1 regroupings of each."""
    rng = np.random.default_rng(SEED)
    return [_drawn(size, draws, rng) for size in sizes]


def _drawn(size: Size, draws: int, rng: np.random.Generator) -> Array:
    n, m, paired = size
    if paired:
        signs = np.concatenate([np.ones((1, n)), rng.choice((1.0, -1.0), size=(draws, n))])
        return np.concatenate([signs, -signs], axis=1) / n
    first = np.repeat([1 / n, -1 / m], [n, m])[None]
    return np.concatenate([first, rng.permuted(np.repeat(first, draws, axis=0), axis=1)])
