"""The LiDAR: level rays among fixtures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import lidar
from causalbench_mujoco.contacts import FIXTURE, Indices
from causalbench_mujoco.engine import mujoco

Array = NDArray[np.float64]

UNSEEN = 2  # the group of geoms that no ray meets; it is drawn like groups 0 and 1


class Scanner:
    """Rays that meet what `classes` (ngeom,) calls fixtures, and neither the robot nor the target."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, classes: Indices) -> None:
        self._model, self._data = model, data
        model.geom_group[classes != FIXTURE] = UNSEEN
        self._seen = np.ones(mujoco.mjNGROUP, dtype=np.uint8)
        self._seen[UNSEEN] = 0
        self._hits = np.empty(lidar.N_RAYS, dtype=np.int32)

    def scan(self, base_pose: Array, position: tuple[float, float, float]) -> Array:
        """Ranges (220,) in metres from `position` on a base at `base_pose` (3,), see `Scene.lidar`."""
        origin, rays = lidar.rays(base_pose, position)
        out = np.empty(lidar.N_RAYS)
        mujoco.mj_multiRay(
            self._model, self._data, origin, rays.ravel(), self._seen, 1, -1, self._hits, out, lidar.N_RAYS,
            lidar.MAX_RANGE,
        )  # fmt: skip
        out[out < 0.0] = lidar.MAX_RANGE
        return out
