"""Where the hands of robosuite's robots are, for tasks over its environments. Importing this imports no simulator."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.task import Seen

Array = NDArray[np.float64]

ACTIONS = ("x", "y", "z", "rx", "ry", "rz", "grip")
"""robosuite's OSC_POSE and its gripper: metres along and radians about the axes of the robot's base, and closing."""


def position(robot: Any) -> Array:
    """(3,) m: the place between the fingers, in the world."""
    return np.array(robot.sim.data.site_xpos[robot.eef_site_id["right"]])


def axes(robot: Any) -> Array:
    """(3, 3): the hand's axes in those of the base, as columns: fingers move along the first, the third is ahead."""
    return base(robot).T @ np.array(robot.sim.data.site_xmat[robot.eef_site_id["right"]]).reshape(3, 3)


def base(robot: Any) -> Array:
    """(3, 3): the axes of the robot's base in the world, as columns."""
    return np.array(robot.sim.data.get_body_xmat(robot.robot_model.root_body)).reshape(3, 3)


def fingers(robot: Any) -> float:
    """Metres between the fingers."""
    first, second = robot.sim.data.qpos[robot._ref_gripper_joint_pos_indexes["right"]]
    return float(first - second)


def direction(matrix: Array, column: int = 0) -> float:
    """Which way that axis of a rotation matrix, (3, 3) or flat, points, seen from above, rad."""
    along = np.asarray(matrix).reshape(3, 3)[:, column]
    return float(np.arctan2(along[1], along[0]))


def nearest(angle: float, period: float) -> float:
    """`angle` as that within half a period of 0, rad, of what looks the same after `period`."""
    return float((angle + period / 2) % period - period / 2)


def snapshot(env: Any) -> bytes:
    """All of an environment's state."""
    from causalbench_robosuite import native

    return native.snapshot(env)


def restore(env: Any, content: bytes) -> Seen:
    """The way back, to the bit."""
    from causalbench_robosuite import native

    return native.restore(env, content)
