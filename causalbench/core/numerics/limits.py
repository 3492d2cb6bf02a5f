"""Bounds of numbers, for what is checked and clipped at every control step."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics.compiled import compiled
from causalbench.core.numerics.gufunc import broadcast

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]


@broadcast("f8[:], f8[:]", "(k)->()")
def largest(values: Array, out: Array) -> None:
    """The largest magnitude (...) of `values` (..., k), NaN where one of them is NaN; 0 of none."""
    out[0] = 0.0
    for value in values:
        if abs(value) > out[0] or math.isnan(value):  # nothing is larger than NaN, so that it stays
            out[0] = abs(value)


@compiled
def clipped(value: float, low: float, high: float) -> float:
    """`value` between `low` and `high`; NaN stays NaN."""
    if value < low:
        return low
    return high if value > high else value


@broadcast("f8[:], f4, f4[:]", "(k),()->(k)")
def within(values: Array, bound: float, out: Array32) -> None:
    """`values` (..., k) as float32 clipped to [-bound, bound]."""
    for i in range(len(values)):
        out[i] = clipped(values[i], -bound, bound)
