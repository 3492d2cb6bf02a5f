"""Rotations for compiled loops: the arithmetic of `rotations`, written into arrays that the caller has.

Called from functions that are compiled (`causalbench.core.numerics.compiled`), where these are compiled in. Quaternions
are (w, x, y, z); `out` is filled in place and must be none of the inputs.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics.compiled import compiled

Array = NDArray[np.float64]


@compiled
def canonical(w: float, x: float, y: float, z: float, out: Array) -> None:
    """`out` (4,) = the quaternion with unit length and the project's sign, w >= 0."""
    scale = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
    if w < 0:
        scale = -scale
    out[0], out[1], out[2], out[3] = w * scale, x * scale, y * scale, z * scale


@compiled
def unturned(yaw: float, q: Array, out: Array) -> None:
    """`out` (4,) = the unit quaternion `q` (4,) seen from a frame that is turned by `yaw` radians about z."""
    cos, sin = math.cos(yaw / 2), math.sin(yaw / 2)
    w, x, y, z = q
    out[0], out[1], out[2], out[3] = cos * w + sin * z, cos * x + sin * y, cos * y - sin * x, cos * z - sin * w


@compiled
def from_matrix(m: Array, out: Array) -> None:
    """`out` (4,) = the canonical quaternion of a rotation matrix, given row by row (9,)."""
    # Shepperd: divide by the largest of the four components.
    trace = m[0] + m[4] + m[8]
    if trace > max(m[0], m[4], m[8]):
        canonical(1 + trace, m[7] - m[5], m[2] - m[6], m[3] - m[1], out)
    elif m[0] >= m[4] and m[0] >= m[8]:
        canonical(m[7] - m[5], 1 + 2 * m[0] - trace, m[1] + m[3], m[2] + m[6], out)
    elif m[4] >= m[8]:
        canonical(m[2] - m[6], m[1] + m[3], 1 + 2 * m[4] - trace, m[5] + m[7], out)
    else:
        canonical(m[3] - m[1], m[2] + m[6], m[5] + m[7], 1 + 2 * m[8] - trace, out)


@compiled
def matrix(q: Array, out: Array) -> None:
    """`out` (3, 3) = the rotation matrix of a unit quaternion `q` (4,)."""
    w, x, y, z = q
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y) - 2 * (z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (z * z) - 2 * (x * x), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x) - 2 * (y * y)


@compiled
def axis_rotation(axis: Array, angle: float, out: Array) -> None:
    """`out` (3, 3) = the rotation by `angle` radians about the unit vector `axis` (3,) (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@compiled
def matmul(a: Array, b: Array, out: Array) -> None:
    """`out` = a b for 3 x 3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled
def rotation_vector(target: Array, actual: Array, out: Array) -> None:
    """`out` (3,) = axis times angle, radians, of the rotation that takes the matrix `actual` to `target`, (3, 3) both.

    The axis is seen in the frame that both matrices lead to.
    """
    r = np.empty((3, 3))
    matmul(target, actual.T, r)
    out[0], out[1], out[2] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    sine2 = np.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    cosine2 = r[0, 0] + r[1, 1] + r[2, 2] - 1.0
    if sine2 < 1e-9 and cosine2 < 0.0:
        # Half a turn: the skew part vanishes. The axis is a column of r + 1.
        k = np.argmax(np.array([r[0, 0], r[1, 1], r[2, 2]]))
        axis = r[:, k].copy()
        axis[k] += 1.0
        out[:] = axis * (np.pi / np.sqrt((axis * axis).sum()))
        return
    scale = 0.5 if sine2 < 1e-9 else np.arctan2(sine2, cosine2) / sine2
    for i in range(3):
        out[i] *= scale
