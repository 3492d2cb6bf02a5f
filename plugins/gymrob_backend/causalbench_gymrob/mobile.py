"""`MobileGymrobScene`: Fetch on a base that drives, with a LiDAR. Everything else is that of `scene.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import base_following as driving
from causalbench.core.kit.robots.fetch import BASE_FORCE, CARRY, LIDAR_POSITION
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.world import lidar
from causalbench.core.world.layout import Box, Layout
from causalbench.core.world.scene import check_action
from causalbench_gymrob.engine import mujoco
from causalbench_gymrob.model import ALL_BITS
from causalbench_gymrob.scene import GymrobScene
from causalbench_gymrob.world import World

Array = NDArray[np.float64]

BASE_KV = (2e4, 2e4, 5e3)  # N s / m, N m s / rad
UNSEEN = 2  # the group of geoms that no ray meets, which is the robot's


class MobileWorld(World):
    """The base's servos hold velocities, and a target of mass 0 neither falls nor touches anything."""

    def __init__(self, timestep: float, n_fixtures: int) -> None:
        super().__init__(timestep, n_fixtures)
        model = self.model
        for servo, kv, force in zip(self.base_servos, BASE_KV, BASE_FORCE, strict=True):
            model.actuator_gainprm[servo, 0] = kv
            model.actuator_biasprm[servo, :3] = 0.0, 0.0, -kv
            model.actuator_forcelimited[servo], model.actuator_forcerange[servo] = True, (-force, force)
        model.geom_group[self.target[1]] = UNSEEN
        self._seen = np.ones(mujoco.mjNGROUP, dtype=np.uint8)
        self._seen[UNSEEN] = 0
        self._hits = np.empty(lidar.N_RAYS, dtype=np.int32)

    def place_base(self, pose: Array) -> None:
        """Put the base at `pose` (3,), at rest."""
        self.qpos[self.base], self.ctrl[self.base_servos] = pose, 0.0

    def furnish(self, fixtures: tuple[Box, ...], target: Box, mass: float) -> None:
        """As `World.furnish`; the body of a mark has some mass, which nothing ever feels."""
        super().furnish(fixtures, target, mass or 1.0)
        body, geom = self.target
        self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = ALL_BITS if mass else 0
        self.model.body_gravcomp[body] = 0.0 if mass else 1.0

    def scan(self) -> Array:
        """Ranges (220,) in metres of the LiDAR."""
        origin, rays = lidar.rays(self.qpos[self.base], LIDAR_POSITION)
        out = np.empty(lidar.N_RAYS)
        mujoco.mj_multiRay(
            self.model, self.data, origin, rays.ravel(), self._seen, 1, -1, self._hits, out, lidar.N_RAYS,
            lidar.MAX_RANGE,
        )  # fmt: skip
        out[out < 0.0] = lidar.MAX_RANGE
        return out


class MobileGymrobScene(GymrobScene):
    """Fetch driving among fixtures, with a free box or a mark."""

    world_type = MobileWorld
    _world: MobileWorld

    def __init__(self, control_hz: float = 10.0, timestep: float = 0.005) -> None:
        super().__init__(control_hz, timestep)
        self.spec = driving.driving_spec(self.spec, CARRY, LIDAR_POSITION)
        self._codec = SnapshotCodec(self.spec)
        self._way = driving.SPEED * self.spec.control_dt
        self._memory = np.zeros(5)
        self._pad_forces, self._reference = self._memory[:2], self._memory[2:]

    def reset(self, layout: Layout) -> None:
        """As `GymrobScene.reset`."""
        self._reference[:] = layout.base_pose
        super().reset(layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` (9,) in [-1, 1]. Raises `InvalidActionError`."""
        action = check_action(action, (len(self.spec.actions),))
        world = self._world
        way = action[:2] * self._way
        world.ctrl[world.base_servos] = driving.follow(
            self._reference, world.qpos[world.base], way, self.spec.control_dt
        )
        super().step(action[2:])

    def lidar(self) -> Array:
        """Ranges (220,) in metres, see `Scene.lidar`."""
        return self._world.scan()
