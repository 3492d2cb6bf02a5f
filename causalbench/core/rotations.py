"""Unit quaternions (w, x, y, z) over any leading batch dimensions, numpy only.

Sign convention of the whole project: the first component that is not zero is positive (`canonical`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product a * b of quaternions (..., 4): rotate by b first, then by a (b in a's frame)."""
    w1, x1, y1, z1 = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    w2, x2, y2, z2 = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
    out[..., 1] = w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2
    out[..., 2] = w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2
    out[..., 3] = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    return out


def conjugate(q: Array) -> Array:
    """Inverse rotation of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def canonical(q: Array) -> Array:
    """Unit length and the project's sign: the first component whose size exceeds 1e-9 is positive."""
    q = q / np.sqrt((q * q).sum(-1, keepdims=True))
    first = np.argmax(np.abs(q) > 1e-9, axis=-1)[..., None]
    return q * np.where(np.take_along_axis(q, first, -1) < 0, -1.0, 1.0)


def from_axis_angle(axis: int, angle: Array | float) -> Array:
    """Rotation by `angle` (...) radians about coordinate axis 0, 1 or 2, as quaternions (..., 4)."""
    half = np.asarray(angle, dtype=np.float64) / 2
    q = np.zeros((*half.shape, 4))
    q[..., 0] = np.cos(half)
    q[..., 1 + axis] = np.sin(half)
    return q


def rotate(q: Array, v: Array) -> Array:
    """Vectors (..., 3) turned by unit quaternions (..., 4)."""
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def z_axis(q: Array) -> Array:
    """Third column (..., 3) of the rotation matrix of q: where the frame's own z axis points."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty(q.shape[:-1] + (3,))
    out[..., 0] = 2 * (x * z + w * y)
    out[..., 1] = 2 * (y * z - w * x)
    out[..., 2] = 1 - 2 * (x * x + y * y)
    return out


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
