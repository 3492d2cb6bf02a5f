"""The level LiDAR of the mobile task, Fetch's 220 degrees in 220 rays (paper, appendix A), among boxes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import kernels
from causalbench.core.numerics.gufunc import broadcast

Array = NDArray[np.float64]

N_RAYS = 220
ANGLES = np.radians(np.linspace(-110.0, 110.0, N_RAYS))
"""Angle of each ray from straight ahead (220,), radians; ray 0 is the rightmost. All lie in the scanner's height."""
POSITION = (0.235, 0.0, 0.2878)
"""Of the scanner in the base frame, m: where Fetch has its laser; one for all robots, so that they see alike."""
MAX_RANGE = 10.0  # m; also what a ray that meets nothing says

N_SECTORS = 20
"""Sectors of equal width, 11 rays each, that stand for a scan where all rays would be too many."""
NEAR, FADING = 0.2, 0.4  # m: what is nearer counts 1, and e times less for every so much farther


def sectors(ranges: NDArray[Any]) -> NDArray[Any]:
    """Proximities (..., 20) of the nearest thing in each sector of scans `ranges` (..., 220): 1 at `NEAR`, 0 for none.

    The dtype stays; sector 0 is the rightmost.
    """
    nearest = ranges.reshape(*ranges.shape[:-1], N_SECTORS, -1).min(-1)
    out: NDArray[Any] = np.exp(-np.maximum(nearest - NEAR, 0.0) / FADING)
    return out


def scanner_pose(base_pose: Array, position: tuple[float, float, float]) -> Array:
    """x, y, z and yaw (..., 4) in the world of a scanner at `position` in the frame of the base (..., 3)."""
    x, y, yaw = np.moveaxis(base_pose, -1, 0)
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left, height = position
    return np.stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left, np.full_like(x, height), yaw], -1)


def rays(base_pose: Array, position: tuple[float, float, float]) -> tuple[Array, Array]:
    """Origin (3,) m and unit directions (220, 3) in the world of a scan from `position` on the base at (3,)."""
    *origin, yaw = scanner_pose(base_pose, position)
    angles = yaw + ANGLES
    return np.array(origin), np.stack([np.cos(angles), np.sin(angles), np.zeros(N_RAYS)], -1)


def scan(boxes: Array, pose: Array) -> Array:
    """Ranges (..., 220) in metres from scanners at `pose` (..., 4) among `boxes`, in closed form.

    The boxes (..., n, 10) are rows of `layout.box_rows`.
    """
    out: Array = _scan(boxes, pose, ANGLES)
    return out


@broadcast("f8[:, :], f8[:], f8[:], f8[:]", "(n,k),(p),(r)->(r)")
def _scan(boxes: Array, pose: Array, angles: Array, out: Array) -> None:
    out[:] = MAX_RANGE
    turn = np.empty((3, 3))
    for row in range(boxes.shape[0]):
        box = boxes[row]
        kernels.matrix(box[6:10], turn)
        dx, dy, dz = pose[0] - box[3], pose[1] - box[4], pose[2] - box[5]
        for ray in range(angles.shape[0]):
            cos, sin = math.cos(pose[3] + angles[ray]), math.sin(pose[3] + angles[ray])
            enter, leave = -math.inf, math.inf
            for axis in range(3):  # slabs, in the box's own frame
                start = turn[0, axis] * dx + turn[1, axis] * dy + turn[2, axis] * dz
                way = turn[0, axis] * cos + turn[1, axis] * sin
                half = box[axis]
                if abs(way) < 1e-12:
                    if abs(start) > half:
                        leave = -math.inf
                else:
                    one, two = (-half - start) / way, (half - start) / way
                    enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
            distance = enter if enter >= 0.0 else leave  # from inside a box: its far side
            if enter <= leave and 0.0 <= distance < out[ray]:
                out[ray] = distance
