"""What the kinematic backend's scenes are, and every number of their closed form: metres, radians, seconds."""

from __future__ import annotations

import numpy as np

from causalbench.core.kit import base_following
from causalbench.core.kit.robots.fetch import CARRY
from causalbench.core.world import lidar
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.layout import Workspace
from causalbench.core.world.scene import ACTION_SPEED, ARM_ACTIONS, SceneSpec

CONTROL_DT = 0.1  # s
SHOULDER_HEIGHT = 0.70  # m
REACH = 0.82  # m
MAX_OPENING = 0.10  # m
SQUEEZE = 0.005  # m by which the commanded opening must undercut a box's width for the box to be held
TABLE_CLEARANCE = 0.005  # m between the table and the lowest hand
AROUND = (0.05, 0.05, 0.03)  # m, hand frame: a box whose centre is this near lies between the fingers
TABLE_HALF, TABLE_MIDDLE = (0.3, 0.5), 0.78  # m, of its picture: half extents, middle ahead of the base
UPRIGHT = 0.3  # rad from straight down within which the fingers can enclose a box
BASE_RADIUS, BASE_HEIGHT = 0.28, 0.40  # m, of the cylinder that carries a hand that drives

WORKSPACE = Workspace(
    table_height=0.70,
    object_low=(0.58, -0.15),
    object_high=(0.70, 0.15),
    hand_low=(0.69, -0.20, 1.00),
    hand_high=(0.77, 0.20, 1.13),
)
SPEC = SceneSpec(
    backend="kinematic",
    backend_version="1",
    engine="numpy",
    engine_version="1",  # the closed form of `worlds`, not numpy's release
    robot="floating hand",
    actions=ARM_ACTIONS,
    action_speed=tuple(ACTION_SPEED[a] for a in ARM_ACTIONS),
    workspace=WORKSPACE,
    max_opening=MAX_OPENING,
    control_dt=CONTROL_DT,
    timestep=CONTROL_DT,
    capabilities=frozenset({Capability.EXACT_RESTORE, Capability.RGB, Capability.SEVERAL_OBJECTS}),
)
MOBILE_SPEC = base_following.driving_spec(SPEC, CARRY, lidar.POSITION)

STEP, BASE_STEP = np.array(SPEC.action_speed) * CONTROL_DT, base_following.SPEED * CONTROL_DT
"""What an action of 1 moves in a control step: hand and gripper (7,), base (2,)."""
