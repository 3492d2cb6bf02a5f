"""A six-hinge arm in plain MuJoCo behind the `Scene` contract; what it has in common with others is the kit's."""

from __future__ import annotations

from importlib import resources

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Workspace, joint_following, lidar
from causalbench_hinge_arm import CAPABILITIES, ROBOT
from causalbench_mujoco import contacts
from causalbench_mujoco.arms import arm_chain
from causalbench_mujoco.bases import FixedBase
from causalbench_mujoco.boxes import TARGET, add_fixtures, add_target
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.scene import MujocoScene, arm_spec
from causalbench_mujoco.world import World

Array = NDArray[np.float64]

CONTROL_HZ, TIMESTEP = 10.0, 0.002  # 1/s, s
JOINTS = ("pan", "lift", "elbow", "bend", "swing", "roll")
ARM, FINGERS = slice(0, 6), slice(6, 8)  # in qpos and in ctrl alike
STROKE, GRIP_LEAD = 0.05, 0.015  # m: opening of each finger; how far a finger's target may run ahead
WORKSPACE = Workspace(0.6, (0.5, -0.15), (0.6, 0.15), (0.5, -0.2, 0.75), (0.8, 0.2, 1.0))
STARTS = [np.array([pan, lift, 1.6, 0.2, 0.0, 0.0]) for lift in (-0.8, -0.3) for pan in (0.0, -0.5, 0.5)]
"""Joint angles (rad), elbow up, from which a reset looks for its pose."""
CLASSES = {"pedestal": contacts.BASE, "left": contacts.LEFT, "right": contacts.RIGHT, TARGET: contacts.TARGET}
CLASSES |= dict.fromkeys(("upper", "forearm", "wrist", "palm"), contacts.ARM)
"""Classes of geoms; all others are fixtures, the floor among them."""


def make_world(n_fixtures: int) -> World:
    """The arm among `n_fixtures` fixtures, with the free box."""
    spec = mujoco.MjSpec.from_string(resources.files(__package__).joinpath("arm.xml").read_text())
    spec.option.timestep = TIMESTEP
    add_fixtures(spec, n_fixtures)
    add_target(spec)
    model = spec.compile()
    classes = np.array([CLASSES.get(model.geom(i).name, contacts.FIXTURE) for i in range(model.ngeom)])
    base, chain = FixedBase(model, "base"), arm_chain(model, JOINTS)
    return World(model, mujoco.MjData(model), base, classes, chain, gap=0.0)


class HingeArmScene(MujocoScene[World]):
    """The arm on its pedestal, with a free box among fixtures and a LiDAR at its foot."""

    def __init__(self) -> None:
        spec = arm_spec(
            "hinge_arm", "0.2.0", ROBOT, WORKSPACE, 2 * STROKE, CONTROL_HZ, TIMESTEP, CAPABILITIES, lidar.POSITION
        )
        super().__init__(spec, make_world(1), STARTS, STROKE)

    def build(self, n_fixtures: int, n_others: int) -> World:
        """A new world; without `Capability.SEVERAL_OBJECTS` there are no others."""
        return make_world(n_fixtures)

    def pose(self, joints: Array, finger: float) -> None:
        """Put arm and fingers, and their servos' targets, at the start of a reset."""
        w = self.world
        w.qpos[ARM] = w.ctrl[ARM] = joints
        w.qpos[FINGERS] = w.ctrl[FINGERS] = finger

    def advance(self, delta: Array, parts: int, substeps: int) -> None:
        """Move the servos' targets by `delta` (7,), `parts` times, and step MuJoCo after each."""
        w = self.world
        for _ in range(parts):
            joint_following.follow(w.chain, w.ctrl[ARM], w.qpos[ARM], delta[:6], substeps * TIMESTEP)
            if delta[6]:
                finger = w.qpos[FINGERS].mean()
                target = np.clip(w.ctrl[FINGERS] - delta[6] / 2, finger - GRIP_LEAD, finger + GRIP_LEAD)
                w.ctrl[FINGERS] = np.clip(target, 0.0, STROKE)
            mujoco.mj_step(w.model, w.data, substeps)

    def opening(self) -> float:
        """Distance in metres between the finger pads."""
        return float(self.world.qpos[FINGERS].sum())
