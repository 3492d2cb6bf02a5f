"""`GymrobScene`: Fetch behind the `Scene` contract. The model is in `model.py`, its control in `control.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import base_following, fetch, lidar
from causalbench_gymrob import CAPABILITIES, __version__, control
from causalbench_gymrob.model import ARM_JOINTS, BASE_JOINTS, FINGER_JOINTS, build, geom_classes
from causalbench_mujoco.arms import arm_chain, closed_gap
from causalbench_mujoco.bases import JointBase
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.fetch_model import FINGERS
from causalbench_mujoco.scene import MujocoScene, arm_spec
from causalbench_mujoco.world import World

Array = NDArray[np.float64]


class FetchWorld(World):
    """Fetch among `n_fixtures` fixtures, with `n_others` boxes beside the target, on a base that `drives` or stands."""

    def __init__(self, timestep: float, n_fixtures: int, n_others: int = 0, drives: bool = False) -> None:
        model = build(timestep, n_fixtures, n_others, drives)
        data = mujoco.MjData(model)
        base = JointBase(model, data, BASE_JOINTS, BASE_JOINTS, drives)
        chain, gap = arm_chain(model, ARM_JOINTS), closed_gap(model, FINGERS)
        super().__init__(model, data, base, geom_classes(model), chain, gap)
        self.address, self.data_address = model._address, data._address
        self.fingers = self.joint_addresses(FINGER_JOINTS)
        self.finger_servos = self.actuator_addresses(FINGER_JOINTS)
        arm, servos = self.joint_addresses(ARM_JOINTS), self.actuator_addresses(ARM_JOINTS)
        # The arm's joints and servos are contiguous: views, not copies.
        self.arm_joints = data.qpos[arm[0] : arm[-1] + 1]
        self.arm_target = data.ctrl[servos[0] : servos[-1] + 1]


class GymrobScene(MujocoScene[FetchWorld]):
    """Fetch and free boxes among fixtures.

    With `mobile` its base drives; then the box may be a mark, and there is a LiDAR.
    """

    def __init__(self, control_hz: float = 10.0, timestep: float = 0.005, mobile: bool = False) -> None:
        world = FetchWorld(timestep, 1, drives=mobile)
        opening = world.gap + 2 * fetch.FINGER_STROKE
        spec = arm_spec(
            "gymrob", __version__, "Fetch", fetch.WORKSPACE, opening, control_hz, timestep, CAPABILITIES
        )  # fmt: skip
        if mobile:
            spec = base_following.driving_spec(spec, fetch.CARRY, lidar.POSITION)
        super().__init__(spec, world, fetch.ARM_STARTS, fetch.FINGER_STROKE)

    def build(self, n_fixtures: int, n_others: int) -> FetchWorld:
        return FetchWorld(self.spec.timestep, n_fixtures, n_others, self._drives)

    def pose(self, joints: Array, finger: float) -> None:
        w = self.world
        w.arm_joints[:] = w.arm_target[:] = joints
        w.qpos[w.fingers] = w.ctrl[w.finger_servos] = finger

    def advance(self, delta: Array, parts: int, substeps: int) -> None:
        w = self.world
        control.control_step(
            w.address, w.data_address, parts, substeps, delta, substeps * self.spec.timestep,
            w.chain, w.arm_target, w.arm_joints, w.qpos, w.ctrl, w.fingers, w.finger_servos,
        )  # fmt: skip

    def opening(self) -> float:
        left, right = self.world.fingers
        return float(self.world.qpos[left] + self.world.qpos[right] + self.world.gap)
