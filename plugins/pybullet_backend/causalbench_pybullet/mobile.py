"""`MobilePybulletScene`: Fetch on a base that drives, with a LiDAR. Everything else is that of `scene.py`."""

from __future__ import annotations

from dataclasses import replace
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Layout, SnapshotCodec, base_following, check_action, fetch, lidar
from causalbench_pybullet.engine import pb
from causalbench_pybullet.reading import read_contacts
from causalbench_pybullet.robot import Robot
from causalbench_pybullet.scene import PybulletScene
from causalbench_pybullet.world import BASE, Shapes, World

Array = NDArray[np.float64]

RAILS = ("base_x", "base_y", "base_yaw")
STATIC, ROBOT, ALL = 2, 4, 7  # groups: Bullet's own of things that do not move; one that no ray needs to look at


class MobileWorld(World):
    """The base moves on motors of its own, and a target of mass 0 touches nothing."""

    def __init__(self, robot: Robot, timestep: float, iterations: int, shapes: Shapes) -> None:
        super().__init__(replace(robot, urdf=robot.urdf.with_name("fetch-mobile.urdf")), timestep, iterations, shapes)
        names = [pb.getJointInfo(self.robot, i, **self._at)[1].decode() for i in range(len(self.links) - 1)]
        self.rails = [names.index(name) for name in RAILS]
        for link in self.links.values():
            pb.setCollisionFilterGroupMask(self.robot, link, ROBOT, ALL, **self._at)
        for link in self.base:  # the base rests in the floor
            pb.setCollisionFilterPair(self.robot, self.floor, link, BASE, enableCollision=0, **self._at)
        if shapes.masses[0] == 0.0:
            pb.setCollisionFilterGroupMask(self.object, BASE, 0, 0, **self._at)

    def place(self, layout: Layout) -> None:
        """As `World.place`; the robot's root stays in the origin."""
        super().place(replace(layout, base_pose=np.zeros(3)))
        for joint, position in zip(self.rails, layout.base_pose.tolist(), strict=True):
            pb.resetJointState(self.robot, joint, position, 0.0, **self._at)
        self.drive(np.zeros(3))

    def drive(self, velocities: Array) -> None:
        """Velocities (3,) of x, y and yaw that the base's motors hold until the next call."""
        pb.setJointMotorControlArray(
            self.robot, self.rails, pb.VELOCITY_CONTROL, targetVelocities=velocities.tolist(), forces=fetch.BASE_FORCE,
            **self._at,
        )  # fmt: skip

    def base_state(self) -> Array:
        """Pose and velocity (6,) of x, y and yaw in the world."""
        states = pb.getJointStates(self.robot, self.rails, self.client)
        return np.array([[state[0] for state in states], [state[1] for state in states]]).ravel()

    def scan(self) -> Array:
        """Ranges (220,) in metres of the LiDAR."""
        origin, rays = lidar.rays(self.base_state()[:3], lidar.POSITION)
        starts, ends = list(repeat(origin.tolist(), lidar.N_RAYS)), (origin + lidar.MAX_RANGE * rays).tolist()
        hits = pb.rayTestBatch(starts, ends, collisionFilterMask=STATIC, **self._at)
        return np.array([lidar.MAX_RANGE * hit[2] for hit in hits])  # the fraction is 1 where nothing is met


class MobilePybulletScene(PybulletScene):
    """Fetch driving among fixtures, with a free box or a mark."""

    world_type = MobileWorld

    def __init__(self, control_hz: float, timestep: float, solver_iterations: int) -> None:
        super().__init__(control_hz, timestep, solver_iterations)
        self.spec = base_following.driving_spec(self.spec, fetch.CARRY, lidar.POSITION)
        self._codec = SnapshotCodec(self.spec)
        self._way = base_following.SPEED * self.spec.control_dt
        self._reference = np.zeros(3)

    @property
    def world(self) -> MobileWorld:
        """As `PybulletScene.world`."""
        world = super().world
        assert isinstance(world, MobileWorld)
        return world

    def reset(self, layout: Layout) -> None:
        """As `PybulletScene.reset`."""
        self._reference[:] = layout.base_pose
        super().reset(layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` (9,) in [-1, 1]. Raises `InvalidActionError`."""
        action = check_action(action, (len(self.spec.actions),))
        measured, way = self.world.base_state()[:3], action[:2] * self._way
        self.world.drive(base_following.follow(self._reference, measured, way, self.spec.control_dt))
        super().step(action[2:])

    def lidar(self) -> Array:
        """Ranges (220,) in metres, see `Scene.lidar`."""
        return self.world.scan()

    def _read_base(self) -> Array:
        x, y, yaw, *velocity = self.world.base_state().tolist()
        ahead = np.cos(yaw) * velocity[0] + np.sin(yaw) * velocity[1]
        return np.array([x, y, yaw, ahead, velocity[2]])

    def _read_flags(self) -> None:
        self._flags[:] = read_contacts(self.world)
