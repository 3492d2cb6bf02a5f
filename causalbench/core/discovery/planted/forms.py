"""How a planted effect depends on its actions: functions of mean 0 and variance 1, and what setting one to 0 does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Form(NamedTuple):
    """A form of an effect.

    `value(a, s, e)` is the contribution of actions `a` (n, n_parts), uniform in [-1, 1], in a state variable `s` (n,)
    and a noise `e` (n,), both standard normal. Over all three it has mean 0 and variance 1. `ratio` is
    E[(value(a) - value(a with one action at 0))^2], which turns a share of a term's variance into the effect size.
    """

    value: Callable[[Array, Array, Array], Array]
    ratio: float


LOCAL_LIMIT = 1.6448536269514722
"""A standard normal state is above it in 5% of the states."""
SATURATION = 1.0 - np.tanh(4.0) / 4.0
"""Variance of tanh(4 a)."""
HUMP = 1.0 / 5.0 - 10.0 / 21.0 + 25.0 / 81.0
"""Variance of a^2 - 5/3 a^4, whose mean is 0."""


def _product(a: Array) -> Array:
    return np.asarray(np.prod(np.sqrt(3.0) * a, axis=1))


def _hump(a: Array, s: Array, e: Array) -> Array:
    square = a[:, 0] ** 2
    return np.asarray((square - 5.0 / 3.0 * square**2) / np.sqrt(HUMP))


FORMS: Mapping[str, Form] = {
    "linear": Form(lambda a, s, e: _product(a), 1.0),
    "product": Form(lambda a, s, e: _product(a), 1.0),
    "sign_product": Form(lambda a, s, e: np.asarray(np.sign(a).prod(1)), 1.0),
    "absolute": Form(lambda a, s, e: (np.abs(a[:, 0]) - 0.5) * np.sqrt(12.0), 4.0),
    "even": Form(_hump, 1.0),
    "cosine": Form(lambda a, s, e: np.sqrt(2.0) * np.cos(2 * np.pi * a[:, 0]), 3.0),
    "saturating": Form(lambda a, s, e: np.tanh(4.0 * a[:, 0]) / np.sqrt(SATURATION), 1.0),
    "threshold": Form(lambda a, s, e: ((a[:, 0] > 0.5) - 0.25) / np.sqrt(3.0 / 16.0), 4.0 / 3.0),
    "local": Form(lambda a, s, e: (s > LOCAL_LIMIT) * np.sqrt(3.0 / 0.05) * a[:, 0], 1.0),
    "sign_of_state": Form(lambda a, s, e: np.sign(s) * np.sqrt(3.0) * a[:, 0], 1.0),
    "variance": Form(lambda a, s, e: e * np.sqrt(3.0) * a[:, 0], 1.0),
}
"""By name; "product" and "sign_product" take two actions or three, the others one. Effects of "even" have the same
value at 0 as on average; "sign_of_state" is hidden where the state variable is."""
