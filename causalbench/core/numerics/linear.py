"""Small systems a x = b with a symmetric positive definite matrix a, for compiled loops; in place.

Two factorizations, which round differently: inverse kinematics has always taken square roots, the innermost loop of a
controller cannot wait for them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics.compiled import compiled

Array = NDArray[np.float64]

# A call that hands over arrays costs more than what these compute.
_inlined = compiled(error_model="numpy", forceinline=True)


@_inlined
def cholesky(a: Array, n: int) -> None:
    """On and below its diagonal `a` (n, n), which is read there alone, becomes L of a = L L^T."""
    for i in range(n):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = np.sqrt(s) if i == j else s / a[j, j]


@_inlined
def cholesky_solve(factor: Array, n: int, x: Array) -> None:
    """Replace `x` (n,) by a^-1 `x`, where `factor` is what `cholesky` makes of a."""
    for i in range(n):
        for k in range(i):
            x[i] -= factor[i, k] * x[k]
        x[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= factor[k, i] * x[k]
        x[i] /= factor[i, i]


@_inlined
def ldl(a: Array, n: int) -> None:
    """Below its diagonal `a` (n, n) becomes L of a = L D L^T, on it D^-1; read on and below the diagonal.

    No square roots: they would wait for one another.
    """
    for j in range(n):
        a[j, j] = 1.0 / max(a[j, j], 1e-14)
        for i in range(j + 1, n):
            share = a[i, j] * a[j, j]
            for k in range(j + 1, i + 1):
                a[i, k] -= share * a[k, j]
        for i in range(j + 1, n):
            a[i, j] *= a[j, j]


@_inlined
def ldl_solve(factor: Array, n: int, x: Array) -> None:
    """Replace `x` (n,) by a^-1 `x`, where `factor` is what `ldl` makes of a."""
    for i in range(n):
        for p in range(i):
            x[i] -= factor[i, p] * x[p]
    for k in range(n):
        i = n - 1 - k
        x[i] *= factor[i, i]
        for p in range(i + 1, n):
            x[i] -= factor[p, i] * x[p]
