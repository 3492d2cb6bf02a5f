"""The ranks that seeds allow: every pair of methods is tested, all pairs being one family."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from causalbench.report.comparison import holm
from causalbench.report.permutation import DRAWS, Array, least_p, regroup
from causalbench.report.stats import ALPHA


def shown_better(methods: Sequence[Sequence[Array]]) -> NDArray[np.bool_]:
    """[i, j]: whether method i, given as one array of seeds per backend, is shown to be better than method j.

    By Holm's step-down over all pairs the chance that any of it is wrong is at most 5%.
    """
    pairs = list(combinations(range(len(methods)), 2))
    tests = [regroup(methods[i], methods[j], most=DRAWS) for i, j in pairs]
    shown = np.zeros((len(methods), len(methods)), dtype=bool)
    for (i, j), test, p in zip(pairs, tests, holm([float(test.two_sided) for test in tests]), strict=True):
        better = test.differences[0] > 0
        shown[(i, j) if better else (j, i)] = p is not None and p <= ALPHA
    return shown


def ranks(shown: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(best, worst) rank of each method that agrees with what is shown."""
    n = len(shown)
    return [(1 + int(shown[:, i].sum()), n - int(shown[i].sum())) for i in range(n)]


def can_show(methods: Sequence[Sequence[Array]]) -> bool:
    """Whether the seeds are enough to tell any two methods apart, however far apart they lie."""
    sizes = [[(len(a), len(b), False) for a, b in zip(x, y, strict=True)] for x, y in combinations(methods, 2)]
    return any(least_p(size) <= ALPHA for size in sizes)
