"""E-values by betting: what a gambler would own who bets against a null hypothesis, state after state.

Under the null hypothesis the capital is expected to shrink, so that it ever reaches 1 / level has at most the chance
`level`, however often one looks (Ville 1939; Waudby-Smith and Ramdas 2024). All functions take numbers (n, ...) in the
order of the states and return log e-values (...), the mean over gamblers who stake different fractions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STAKES = (0.5, 0.1, 0.02)  # fractions of the capital: for effects in every state, in some, in few
SIGNED = (0.9, 0.5, 0.25, 0.1)
BOLD = 0.9  # of the capital is with who bets all that an unseen event allows
SMALLEST = 1e-300


def above(values: Array, limit: Array | float) -> Array:
    """Evidence that non-negative `values` have a mean above `limit`, whatever their distribution."""
    gain = values / np.fmax(limit, SMALLEST) - 1.0
    return _mean([np.log1p(stake * gain).sum(0) for stake in STAKES])


def below(values: Array, limit: Array | float, largest: Array | float) -> Array:
    """Evidence that non-negative `values`, at most `largest` where they are not 0, have a mean below `limit`.

    Without such a bound none is possible: a rare event of any size may not have been seen yet.
    """
    ratio = values / np.fmax(limit, SMALLEST)
    whole = np.fmax(largest / np.fmax(limit, SMALLEST) - 1.0, 1.0)
    bold, timid = (np.log(np.fmax(1.0 + stake / whole * (1.0 - ratio), SMALLEST)).sum(0) for stake in (1.0, 0.5))
    return np.asarray(np.logaddexp(bold + np.log(BOLD), timid + np.log1p(-BOLD)))


def positive(values: Array, both_signs: bool = False) -> Array:
    """Evidence that `values`, whose signs are a fair coin under the null hypothesis, tend to be positive.

    With `both_signs`: to either side. Valid for any distribution that is symmetric about 0, with heavy tails, too: a
    bet is on the value in units of the mean size of those before it, cut at 1.
    """
    size = np.cumsum(np.abs(values), axis=0)
    count = np.arange(1, len(values)).reshape(-1, *[1] * (values.ndim - 1))
    cut = np.clip(values[1:] / np.fmax(2.0 * size[:-1] / count, SMALLEST), -1.0, 1.0)
    stakes = [*SIGNED, *(-stake for stake in SIGNED)] if both_signs else SIGNED
    return _mean([np.log1p(stake * cut).sum(0) for stake in stakes])


def either(one: Array, other: Array) -> Array:
    """The evidence of who puts half of the capital on each."""
    return _mean([one, other])


def _mean(logs: list[Array]) -> Array:
    """Log of the mean of what is given by its logs."""
    return np.asarray(np.logaddexp.reduce(logs, axis=0) - np.log(len(logs)))
