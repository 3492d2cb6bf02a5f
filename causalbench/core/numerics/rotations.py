"""Unit quaternions (w, x, y, z), single (4,) or in batches (n, 4); numpy only. For compiled loops there is `kernels`.

Sign convention of the whole project: w >= 0 (`canonical`). Components are handled one by one (`components`)
rather than by `np.cross` and the like: for single poses plain floats are ten times faster than tiny arrays, and
stepping loops call this all the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FACE_DOWN = np.array([0.0, 0.0, 1.0, 0.0])
"""A hand that points straight down, seen from the base: its closing axis lies along base y."""


def components(a: Array) -> Any:
    """The entries of the last axis: floats for one vector (k,), arrays (n,) for a batch (n, k)."""
    return a.tolist() if a.ndim == 1 else a.T


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product a * b (..., 4): rotate by b first, then by a (b in a's frame)."""
    w1, x1, y1, z1 = components(a)
    w2, x2, y2, z2 = components(b)
    return np.array(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ]
    ).T


def conjugate(q: Array) -> Array:
    """Inverse rotation of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def canonical(q: Array) -> Array:
    """The same rotation (..., 4) with unit length and the project's sign, w >= 0."""
    w, x, y, z = q.T
    scale = np.where(w < 0, -1.0, 1.0) / np.sqrt(w * w + x * x + y * y + z * z)
    return (q.T * scale).T


def from_axis_angle(axis: int, angle: Array | float) -> Array:
    """Rotation by `angle` (...) radians about coordinate axis 0, 1 or 2, as quaternions (..., 4)."""
    half = np.asarray(angle, dtype=np.float64) / 2
    q = np.zeros((*half.shape, 4))
    q[..., 0] = np.cos(half)
    q[..., 1 + axis] = np.sin(half)
    return q


def from_own_angles(angles: Array) -> Array:
    """Rotation (..., 4) by `angles` (..., 3) radians about the body's own x, then its own y, then its own z."""
    half = angles.T / 2
    (cx, cy, cz), (sx, sy, sz) = np.cos(half), np.sin(half)
    return np.array(
        [
            cx * cy * cz - sx * sy * sz,
            sx * cy * cz + cx * sy * sz,
            cx * sy * cz - sx * cy * sz,
            cx * cy * sz + sx * sy * cz,
        ]
    ).T


def rotate(q: Array, v: Array) -> Array:
    """Vectors (..., 3) turned by unit quaternions (..., 4): v + w t + u x t with t = 2 u x v, u = (x, y, z)."""
    w, x, y, z = components(q)
    vx, vy, vz = components(v)
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return np.array(
        [
            vx + w * tx + y * tz - z * ty,
            vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx,
        ]
    ).T


def rotation_vector(q: Array) -> Array:
    """Axis times angle (..., 3) in radians, angle at most pi, of unit quaternions (..., 4)."""
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.sqrt((q[..., 1:] ** 2).sum(-1, keepdims=True))
    angle = 2 * np.arctan2(sine, q[..., :1])
    # Below 1e-9 the ratio angle / sine is 2 to machine precision and the division is not safe.
    return q[..., 1:] * np.where(sine < 1e-9, 2.0, angle / np.maximum(sine, 1e-9))


def angle_between(a: Array, b: Array) -> Array:
    """Angle (...) in radians of the rotation that takes a to b."""
    return np.sqrt((rotation_vector(multiply(conjugate(a), b)) ** 2).sum(-1))


def matrix(q: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion (4,)."""
    return np.column_stack([rotate(q, axis) for axis in np.eye(3)])


def from_matrix(m: Array) -> Array:
    """The unit quaternion (4,), w >= 0, of a rotation matrix (3, 3)."""
    # Shepperd: four times the quaternion's outer product with itself; its longest row is the safest to normalise.
    (a, b, c), (d, e, f), (g, h, i) = m
    trace = a + e + i
    outer = np.array(
        [
            [1 + trace, h - f, c - g, d - b],
            [h - f, 1 + 2 * a - trace, b + d, c + g],
            [c - g, b + d, 1 + 2 * e - trace, f + h],
            [d - b, c + g, f + h, 1 + 2 * i - trace],
        ]
    )
    return canonical(outer[np.diag(outer).argmax()])
