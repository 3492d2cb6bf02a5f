"""Fetch as the tasks use it: what must be equal in every simulator that simulates this robot. Names no simulator."""

from __future__ import annotations

import numpy as np

from causalbench.core.world.layout import Carry, Workspace

JOINTS = ("shoulder_pan", "shoulder_lift", "upperarm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll")
"""The arm's joints from the base to the hand; in the robot's files their names end in "_joint"."""

WORKSPACE = Workspace(
    table_height=0.60,
    object_low=(0.66, -0.15),
    object_high=(0.74, 0.15),
    hand_low=(0.65, -0.20, 0.75),
    hand_high=(0.98, 0.20, 1.05),
)
"""Result of a scan of the arm's reach (`causalbench.core.kit.reach_scan`).

The box starts where its hover pose, tilted or not, and its grasp are all in reach; the hand no higher than the upper
arm stays clear of the head on the way down.
"""

CARRY = Carry(hand_low=(0.55, -0.08, 0.68), hand_high=(0.62, 0.08, 0.80), tilt=1.4, footprint=0.70)
"""Start pose of the hand on a driving Fetch: nearly level, from there every target that is near can be reached."""
ARM_FORCE = (150.0, 150.0, 100.0, 100.0, 60.0, 60.0, 40.0)  # N m, of the arm's motors
BASE_FORCE = (1500.0, 1500.0, 500.0)  # N, N, N m: what the wheels of a robot of this weight can push

TORSO_HEIGHT = 0.30  # m of torso lift
HEAD_TILT = 0.6  # rad downwards
EEF_POSITION = (0.02, 0.0, 0.0)  # m, of the end effector in the gripper link
# Of the gripper link's frame x is the approach axis; ours is z, with y, the closing axis, in common.
EEF_QUATERNION = (float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5)), 0.0)
FINGER_STROKE = 0.05  # m by which each finger opens
FINGER_MASS, FINGER_INERTIA = 0.06, 1e-4  # kg, kg m2: those of Gymnasium-Robotics are 4 kg, too heavy for the wrist
HULL_VERTICES = 64  # at most, of a link's collision shape

ARM_STARTS = tuple(
    np.array([pan, *rest])
    for rest in ((-0.8, 0.0, 1.9, 0.0, -0.5, 0.0), (-0.3, 0.0, 1.3, 0.0, 0.6, 0.0), (0.4, 0.0, 0.8, 0.0, 0.4, 0.0))
    for pan in (0.0, -0.5, 0.5)
)
"""Joint angles (rad) from which a reset looks for its pose, elbow up, in this order."""
