"""Engine-neutral descriptions of a start: boxes, a robot base pose and an end-effector pose."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

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
    """A box: half extents (3,) in m along its own axes; centre (3,) in m and quaternion (w, x, y, z) in the world."""

    name: str
    half_extents: Array
    position: Array
    quaternion: Array


def box_rows(boxes: Iterable[Box]) -> Array:
    """Half extents, positions and quaternions of boxes as one array (n, 10)."""
    return np.array([[*box.half_extents, *box.position, *box.quaternion] for box in boxes]).reshape(-1, 10)


@dataclass(frozen=True)
class Layout:
    """The start of a scene, in the world frame. `fixtures` never move; `target` is the free object of the task.

    A target of mass 0 is a mark in space: it neither moves nor touches anything, and no ray meets it. Only scenes with
    the capability `MOBILE_BASE` take one. `others` are further free objects, each with its mass in `other_masses`; only
    scenes with `SEVERAL_OBJECTS` take any. `extras` are named numbers of the start, float or float64 of any shape, that
    no scene reads and every snapshot keeps: the task that drew the layout finds them in `Facts.extras`.

    Raises `ValueError` unless every other object has a mass above 0.
    """

    fixtures: tuple[Box, ...]
    target: Box
    target_mass: float  # kg
    base_pose: Array  # (3,) x m, y m, yaw rad
    eef_position: Array  # (3,) m
    eef_quaternion: Array  # (4,)
    gripper_opening: float  # m between the finger pads
    others: tuple[Box, ...] = ()
    other_masses: tuple[float, ...] = ()  # kg
    extras: Mapping[str, float | Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.others) != len(self.other_masses) or not all(mass > 0 for mass in self.other_masses):
            names = [box.name for box in self.others]
            raise ValueError(f"other_masses {self.other_masses}: expected a mass above 0 kg for each of {names}")
