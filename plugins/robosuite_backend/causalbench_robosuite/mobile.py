"""`MobileRobosuiteScene`: robosuite's PandaOmron, whose base drives, with a LiDAR. All else is that of `scene.py`.

What is changed in the stock model and its base controller stands beside each edit; the README says why.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import base_following as driving
from causalbench.core.kit import contacts as readings
from causalbench.core.kit.robots.fetch import LIDAR_POSITION  # the same rooms and scans as Fetch's
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.world import lidar
from causalbench.core.world.layout import Box, Carry, Layout, Workspace
from causalbench.core.world.scene import check_action
from causalbench_robosuite import model as panda
from causalbench_robosuite.engine import mujoco
from causalbench_robosuite.scene import WORKSPACE, RobosuiteScene
from causalbench_robosuite.world import World

Array = NDArray[np.float64]

OMRON = "mobilebase0_"  # robosuite's prefix
BASE_JOINTS = tuple(f"{OMRON}joint_mobile_{name}" for name in ("forward", "side", "yaw"))
BASE_SERVOS = tuple(f"{OMRON}actuator_mobile_{name}" for name in ("forward", "side", "yaw"))
BASE_KV = (1e4, 1e4, 3e3)  # N s / m, N m s / rad
AXIS = 0.21  # m by which the axis of turning lies behind the foot of the arm
FOOT, FIXED_FOOT = 0.70, 0.912  # m, height of the foot of the arm with the torso down, and on the fixed Panda's mount
UNSEEN = 2  # the group of geoms that no ray meets

CARRY = Carry(hand_low=(0.55, -0.08, 0.68), hand_high=(0.62, 0.08, 0.80), tilt=0.0, footprint=0.70)
"""The hand points straight down: that near, a Panda cannot hold it level as Fetch does."""


def _workspace() -> Workspace:
    """That of the fixed Panda, seen from the axis on which the base turns."""
    up = FOOT - FIXED_FOOT
    (x0, y0), (x1, y1) = WORKSPACE.object_low, WORKSPACE.object_high
    (a0, b0, c0), (a1, b1, c1) = WORKSPACE.hand_low, WORKSPACE.hand_high
    return Workspace(
        table_height=round(WORKSPACE.table_height + up, 3),
        object_low=(x0 + AXIS, y0),
        object_high=(x1 + AXIS, y1),
        hand_low=(a0 + AXIS, b0, round(c0 + up, 3)),
        hand_high=(a1 + AXIS, b1, round(c1 + up, 3)),
    )


class MobileWorld(World):
    """The base's servos hold velocities, and a target of mass 0 neither falls nor touches anything."""

    def __init__(self, timestep: float, n_fixtures: int) -> None:
        super().__init__(timestep, n_fixtures)
        model = self.model
        joints = [model.joint(name) for name in BASE_JOINTS]
        self.servos = np.array([model.actuator(name).id for name in BASE_SERVOS])
        self.rails = np.array([int(joint.qposadr[0]) for joint in joints])
        self._rail_dofs = np.array([int(joint.dofadr[0]) for joint in joints])
        self.robot = self.robot._replace(base=self.rails)
        model.geom_group[self.classes != readings.FIXTURE] = UNSEEN
        self._seen = np.ones(mujoco.mjNGROUP, dtype=np.uint8)
        self._seen[UNSEEN] = 0
        self._hits = np.empty(lidar.N_RAYS, dtype=np.int32)

    @staticmethod
    def build(timestep: float, n_fixtures: int) -> mujoco.MjModel:
        """The PandaOmron with its torso down, its axis of turning above the origin."""
        spec = panda.assemble("PandaOmron", timestep, n_fixtures)
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # explicit damping of stiff servos diverges
        spec.body(panda.ROOT).pos = [AXIS, 0.0, 0.0]
        spec.delete(spec.actuator(f"{OMRON}actuator_torso_height"))
        spec.delete(spec.joint(f"{OMRON}joint_torso_height"))
        spec.body(panda.OBJECT).gravcomp = 1.0  # so that the compiled model can compensate gravity at all
        for name, servo, kv in zip(BASE_JOINTS, BASE_SERVOS, BASE_KV, strict=True):
            # 250 N of dry friction along each axis of the world, whatever the heading: slow bases stop, others swerve.
            spec.joint(name).frictionloss = 0.0
            actuator = spec.actuator(servo)
            actuator.gainprm[0], actuator.biasprm[2] = kv, -kv
        return spec.compile()

    def place_base(self, base_pose: Array) -> None:
        """Put the base at (x m, y m, yaw rad), at rest."""
        self.views.qpos[self.rails], self.views.ctrl[self.servos] = base_pose, 0.0

    def base_state(self) -> tuple[Array, Array]:
        """As `World.base_state`."""
        pose, speed = self.views.qpos[self.rails], self.views.qvel[self._rail_dofs]
        ahead = np.cos(pose[2]) * speed[0] + np.sin(pose[2]) * speed[1]
        return pose, np.array([ahead, speed[2]])

    def furnish(self, base_pose: Array, fixtures: tuple[Box, ...], target: Box, mass: float) -> None:
        """As `World.furnish`; the body of a mark has some mass, which nothing ever feels."""
        super().furnish(base_pose, fixtures, target, mass or 1.0)
        body, geom = self.target
        self.model.geom_contype[geom] = self.model.geom_conaffinity[geom] = 1 if mass else 0
        self.model.body_gravcomp[body] = 0.0 if mass else 1.0

    def scan(self) -> Array:
        """Ranges (220,) in metres of the LiDAR."""
        origin, rays = lidar.rays(self.views.qpos[self.rails], LIDAR_POSITION)
        out = np.empty(lidar.N_RAYS)
        mujoco.mj_multiRay(
            self.model, self.data, origin, rays.ravel(), self._seen, 1, -1, self._hits, out, lidar.N_RAYS,
            lidar.MAX_RANGE,
        )  # fmt: skip
        out[out < 0.0] = lidar.MAX_RANGE
        return out


class MobileRobosuiteScene(RobosuiteScene):
    """The PandaOmron driving among fixtures, with a free box or a mark."""

    world_type = MobileWorld
    robot, workspace = "PandaOmron", _workspace()
    _world: MobileWorld

    def __init__(self, control_hz: float = 10.0, timestep: float = 0.002) -> None:
        super().__init__(control_hz, timestep)
        self.spec = driving.driving_spec(self.spec, CARRY, LIDAR_POSITION)
        self._codec = SnapshotCodec(self.spec)
        self._way = driving.SPEED * self.spec.control_dt
        self._memory = np.zeros(5)
        self._pad_forces, self._reference = self._memory[:2], self._memory[2:]

    def reset(self, layout: Layout) -> None:
        """As `RobosuiteScene.reset`."""
        self._reference[:] = layout.base_pose
        super().reset(layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` (9,) in [-1, 1]. Raises `InvalidActionError`."""
        action = check_action(action, (len(self.spec.actions),))
        world = self._world
        world.views.ctrl[world.servos] = driving.follow(
            self._reference, world.views.qpos[world.rails], action[:2] * self._way, self.spec.control_dt
        )
        super().step(action[2:])

    def lidar(self) -> Array:
        """Ranges (220,) in metres, see `Scene.lidar`."""
        return self._world.scan()
