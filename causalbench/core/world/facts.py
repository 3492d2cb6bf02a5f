"""What is so in a world at the end of a control step: all that a task may see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

HOLDING_FORCE = 5.0  # N of each pad on the object: two and a half times the weight of the task's box
"""With more than this both pads must press for `Facts.holding`, in simulators that tell forces."""


@dataclass(frozen=True, slots=True)
class Facts:
    """All that a task may see, at the end of a control step, in the world frame.

    Shapes are those of one world; all fields may carry the same one leading batch dimension. Arrays are the
    reader's own: never views of simulator memory. A collision flag is true if the contact exists at the end of
    the control step; the arm includes the gripper; the floor counts as every other thing that is not the robot;
    contact with the task object is not a collision. `holding` is
    true when both finger pads press on the task object.
    """

    eef_position: Array  # (..., 3) m
    eef_quaternion: Array  # (..., 4)
    gripper_opening: Array  # (...) m between the finger pads
    holding: Flags  # (...)
    object_position: Array  # (..., 3) m, centre of the task object
    object_quaternion: Array  # (..., 4)
    base_pose: Array  # (..., 3) x m, y m, yaw rad
    base_velocity: Array  # (..., 2) forward m/s, turn rad/s
    collision_base: Flags  # (...)
    collision_arm: Flags  # (...)
    collision_self: Flags  # (...)
