"""Engine-neutral descriptions of a start: boxes, a robot base pose and an end-effector pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Carry:
    """How a robot that drives carries its hand; metres and radians, robot base frame, from a scan of the arm's reach.

    `hand_low`, `hand_high` (x, y, z) bound the end effector at a start, which points `tilt` forward of straight down.
    `footprint` is the radius about the base's axis of turning that base, arm and hand then stay within.
    """

    hand_low: tuple[float, float, float]
    hand_high: tuple[float, float, float]
    tilt: float
    footprint: float


@dataclass(frozen=True)
class Workspace:
    """Where objects and the hand may start: boxes in the robot base frame, metres, from a scan of the arm's reach.

    `object_low`, `object_high` (x, y) bound the centre of the task object on the table;
    `hand_low`, `hand_high` (x, y, z) bound the end effector.
    """

    table_height: float
    object_low: tuple[float, float]
    object_high: tuple[float, float]
    hand_low: tuple[float, float, float]
    hand_high: tuple[float, float, float]
    carry: Carry | None = None
    """None for a robot that does not drive."""


@dataclass(frozen=True)
class Box:
    """A box: half extents (3,) along its own axes, centre (3,) in metres and quaternion (4,) in the world."""

    name: str
    half_extents: Array
    position: Array
    quaternion: Array


@dataclass(frozen=True)
class Layout:
    """A start, in the world frame. `fixtures` never move; `target` is the free object of the task.

    A target of mass 0 is a mark in space: it neither moves nor touches anything, and no ray meets it. Only scenes with
    the capability `MOBILE_BASE` take one.
    """

    fixtures: tuple[Box, ...]
    target: Box
    target_mass: float  # kg
    base_pose: Array  # (3,) x m, y m, yaw rad
    eef_position: Array  # (3,) m
    eef_quaternion: Array  # (4,)
    gripper_opening: float  # m between the finger pads
