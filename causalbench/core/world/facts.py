"""What is so in a world at the end of a control step: all that a task may see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

HOLDING_FORCE = 5.0  # N of each pad on the object: two and a half times the weight of the task's box
"""With more than this both pads must press for `Facts.holding`, in simulators that tell forces."""

NO_POSITIONS, NO_QUATERNIONS = np.empty((0, 3)), np.empty((0, 4))
"""Of the objects beside the target, where there are none: one array for all, so that they cost nothing."""


@final
@dataclass(frozen=True, slots=True)
class Facts:
    """All that a task may see, at the end of a control step, in the world frame.

    Shapes are those of one world; all fields may carry the same one leading batch dimension. Arrays are the
    reader's own: never views of simulator memory. A collision flag is true if the contact exists at the end of
    the control step; the arm includes the gripper; the floor counts as every other thing that is not the robot;
    contact with one of the task's objects is not a collision. `holding` is
    true when both finger pads press on the target, the first of them, whose pose is `object_position` and
    `object_quaternion`; the further ones follow in the order of `Layout.others`.

    Worlds of one batch may have different numbers of objects: the poses of those that a world lacks are NaN, and where
    none has any, the two fields of the others need no batch dimension. `extras` are named numbers, float64 of any
    shape, the same names in every world of a batch: those of the start (`Layout.extras`), which staged worlds add for
    the task, and those that a scene has to say. The class cannot be subclassed, since a field that only some facts
    have would be lost in a batch.
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
    other_positions: Array = field(default_factory=lambda: NO_POSITIONS)  # (..., n_others, 3) m
    other_quaternions: Array = field(default_factory=lambda: NO_QUATERNIONS)  # (..., n_others, 4)
    extras: Mapping[str, Array] = field(default_factory=dict)

    def __init_subclass__(cls) -> None:
        raise TypeError(
            f"{cls.__name__}: Facts has no subclasses; put further numbers into `extras`, which batches and "
            "snapshots keep"
        )
