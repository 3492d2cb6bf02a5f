"""Fetch as gymnasium-robotics installs it, with what every simulator of it changes alike. No robot file is shipped."""

from __future__ import annotations

import numpy as np

from causalbench.backend import fetch
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.fetch_assets import fetch_assets

PREFIX = "robot0:"
FINGERS = ("robot0:l_gripper_finger_link", "robot0:r_gripper_finger_link")
FIXED_JOINTS = ("robot0:torso_lift_joint", "robot0:head_pan_joint", "robot0:head_tilt_joint")


def load() -> mujoco.MjSpec:
    """The stock model with torso and head fixed, light fingers and hulls of few vertices."""
    spec = mujoco.MjSpec.from_file(str(fetch_assets() / "fetch" / "pick_and_place.xml"))
    torso = spec.body("robot0:torso_lift_link")
    torso.pos = np.add(torso.pos, [0.0, 0.0, fetch.TORSO_HEIGHT])
    spec.body("robot0:head_tilt_link").quat = [np.cos(fetch.HEAD_TILT / 2), 0.0, np.sin(fetch.HEAD_TILT / 2), 0.0]
    for name in FIXED_JOINTS:  # no action moves them, so they cost no degrees of freedom
        spec.delete(spec.joint(name))
    for name in FINGERS:
        body = spec.body(name)
        body.mass, body.inertia, body.ipos = fetch.FINGER_MASS, [fetch.FINGER_INERTIA] * 3, [0.0, 0.0, 0.0]
    for mesh in spec.meshes:
        mesh.maxhullvert = fetch.HULL_VERTICES
    return spec
