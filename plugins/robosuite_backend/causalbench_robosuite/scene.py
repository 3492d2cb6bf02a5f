"""`RobosuiteScene`: robosuite's Panda and PandaOmron behind the `Scene` contract."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Carry, Workspace, base_following, lidar
from causalbench_mujoco.scene import MujocoScene, arm_spec
from causalbench_robosuite import CAPABILITIES, __version__, control, structs
from causalbench_robosuite.model import AXIS, FINGER_STROKE, FIXED_FOOT, FOOT, gains
from causalbench_robosuite.world import PandaWorld

Array = NDArray[np.float64]

WORKSPACE = Workspace(
    table_height=1.25,
    object_low=(0.46, -0.15),
    object_high=(0.54, 0.15),
    hand_low=(0.45, -0.20, 1.42),
    hand_high=(0.62, 0.20, 1.58),
)
"""Result of `python -m causalbench_robosuite.reach_scan`; see the README."""
CARRY = Carry(hand_low=(0.55, -0.08, 0.68), hand_high=(0.62, 0.08, 0.80), tilt=0.0, footprint=0.70)
"""The hand points straight down: that near, a Panda cannot hold it level as Fetch does."""

UNCOUPLED = False  # robosuite's option `uncouple_pos_ori`: on, a hand that starts to sink tilts by 0.1 rad
LEAD, TURN_LEAD = 0.015, 0.06  # m, rad by which the hand's reference may run ahead: what a reversal needs
GRIP_LEAD = 0.015  # m by which a finger's target may run ahead of the finger: 15 N of grip
ARM_STARTS = tuple(
    np.array([pan, shoulder, 0.0, elbow, 0.0, wrist, np.pi / 4 + pan])
    for shoulder, elbow, wrist in ((0.0, -2.0, 2.5), (0.4, -1.6, 2.2), (-0.4, -2.4, 2.5))
    for pan in (0.0, -0.4, 0.4)
)
"""Joint angles (rad) from which a reset looks for its pose, elbow up, in this order."""


def mobile_workspace() -> Workspace:
    """That of the fixed Panda, seen from the axis on which the PandaOmron's base turns."""
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


class RobosuiteScene(MujocoScene[PandaWorld]):
    """The Panda and free boxes among fixtures.

    With `mobile` it is the PandaOmron, whose base drives; then the box may be a mark, and there is a LiDAR.
    """

    def __init__(self, control_hz: float = 10.0, timestep: float = 0.002, mobile: bool = False) -> None:
        world = PandaWorld(timestep, 1, drives=mobile)
        robot, workspace = ("PandaOmron", mobile_workspace()) if mobile else ("Panda", WORKSPACE)
        opening = world.gap + 2 * FINGER_STROKE
        spec = arm_spec("robosuite", __version__, robot, workspace, opening, control_hz, timestep, CAPABILITIES)
        if mobile:
            spec = base_following.driving_spec(spec, CARRY, lidar.POSITION)
        super().__init__(spec, world, ARM_STARTS, FINGER_STROKE, n_memory=structs.N_JOINTS + 1)
        joints, finger = self.memory[: structs.N_JOINTS], self.memory[structs.N_JOINTS :]
        self.reference = structs.Reference(joints, finger, np.zeros(3), np.eye(3))
        self._law = structs.Law(*gains(), UNCOUPLED, LEAD, TURN_LEAD, GRIP_LEAD)

    def build(self, n_fixtures: int, n_others: int) -> PandaWorld:
        return PandaWorld(self.spec.timestep, n_fixtures, n_others, self._drives)

    def pose(self, joints: Array, finger: float) -> None:
        w = self.world
        w.qpos[w.robot.joints] = self.reference.joints[:] = joints
        w.qpos[w.robot.fingers] = w.ctrl[w.robot.servos] = finger, -finger
        self.reference.finger[:] = finger

    def advance(self, delta: Array, parts: int, substeps: int) -> None:
        w = self.world
        control.control_step(
            w.model._address, w.data._address, parts, substeps, delta, self.spec.timestep,
            w.chain, w.frame, w.robot, self._law, self.reference, w.views,
        )  # fmt: skip

    def opening(self) -> float:
        first, second = self.world.robot.fingers
        return max(float(self.world.qpos[first] - self.world.qpos[second] + self.world.gap), 0.0)
