"""Pictures of the kinematic worlds: rays from a camera to the nearest of a few boxes, in numpy. Not a renderer."""

from __future__ import annotations

import functools
import itertools

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.world.cameras import FOV, Camera
from causalbench.core.world.facts import Facts

Array = NDArray[np.float64]
Colour = tuple[int, int, int]
Solid = tuple[Array, Colour]
"""A box (10,), as in `layout.box_rows`, and what it is painted with."""

SKY, FLOOR, FIXTURE = (190, 205, 225), (110, 110, 110), (191, 178, 158)
BASE, HAND, FINGER = (150, 150, 160), (235, 235, 230), (60, 60, 60)
TARGET, OTHER = (217, 51, 26), (38, 102, 204)
SHADE = np.array([0.75, 0.6, 1.0])  # of a box's sides along its own x, y and z
PALM_HALF, FINGER_HALF = (0.03, 0.06, 0.035), (0.012, 0.006, 0.03)  # m
PALM_BACK = 0.07  # m from the end effector back along the approach axis to the middle of the palm
REACH, NEAR = float(np.tan(np.radians(FOV) / 2)), 0.01  # of the view per metre ahead, up and down; m
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
MARK_HALF = (0.03, 0.03, 0.03)  # m: a mark has no extents of its own


def draw(
    facts: Facts, fixtures: Array, halves: Array, carried: bool, width: int, height: int, camera: Camera
) -> NDArray[np.uint8]:
    """RGB image (height, width, 3) of one world with `fixtures` (n, 10) as `layout.box_rows` gives them.

    `halves` (1 + n_others, 3) are the half extents of the target, 0 for a mark, and of the other objects, NaN for those
    that are not there; `carried` says whether the hand is on a base.
    """
    solid = [(row, FIXTURE) for row in fixtures]
    solid += _hand(facts)
    target_half = halves[0] if halves[0].any() else MARK_HALF
    solid.append((_row(target_half, facts.object_position, facts.object_quaternion), TARGET))
    others = zip(halves[1:], facts.other_positions, facts.other_quaternions, strict=True)
    solid += [(_row(*other), OTHER) for other in others if not np.isnan(other[0]).any()]
    if carried:
        x, y, yaw = facts.base_pose
        solid.append((_row((0.2, 0.2, 0.2), np.array([x, y, 0.2]), rotations.from_axis_angle(2, yaw)), BASE))
    rays, eye = _rays(width, height, camera), np.array(camera.eye)
    with np.errstate(divide="ignore"):
        nearest = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
    image = np.where(np.isfinite(nearest)[..., None], FLOOR, SKY).astype(np.uint8)
    for row, colour in solid:
        where = _window(row, width, height, camera)
        distance, axis = _meet(row, eye, rays[where])
        seen = distance < nearest[where]
        nearest[where][seen] = distance[seen]
        image[where][seen] = (SHADE[:, None] * colour).astype(np.uint8)[axis[seen]]
    return image


def _row(half: Array | tuple[float, ...], position: Array, quaternion: Array) -> Array:
    return np.concatenate([half, position, quaternion])


def _hand(facts: Facts) -> list[Solid]:
    """A palm and two fingers, as far apart as the gripper is open."""
    position, quaternion, opening = facts.eef_position, facts.eef_quaternion, float(facts.gripper_opening)

    def part(
        half: tuple[float, ...], offset: tuple[float, ...], colour: tuple[int, int, int]
    ) -> tuple[Array, tuple[int, int, int]]:
        return _row(half, position + rotations.rotate(quaternion, np.array(offset)), quaternion), colour

    side = opening / 2 + FINGER_HALF[1]
    fingers = [part(FINGER_HALF, (0.0, sign * side, -0.01), FINGER) for sign in (1.0, -1.0)]
    return [part(PALM_HALF, (0.0, 0.0, -PALM_BACK), HAND), *fingers]


@functools.lru_cache(maxsize=8)
def _rays(width: int, height: int, camera: Camera) -> Array:
    """Directions (height, width, 3) through the middle of every pixel, from the upper left."""
    right, up, forward = camera.axes()
    scale = 2 * REACH / height
    across = (np.arange(width) + 0.5 - width / 2) * scale
    rise = (height / 2 - np.arange(height) - 0.5) * scale
    return forward + rise[:, None, None] * up + across[:, None] * right


def _window(row: Array, width: int, height: int, camera: Camera) -> tuple[slice, slice]:
    """Rows and columns of the picture outside of which a box is not seen."""
    corners = row[3:6] + (CORNERS * row[:3]) @ rotations.matrix(row[6:10]).T - np.array(camera.eye)
    right, up, forward = camera.axes()
    depth = corners @ forward
    if depth.min() < NEAR:  # partly behind the camera
        return slice(None), slice(None)
    scale = height / 2 / REACH / depth
    across, down = width / 2 + scale * (corners @ right), height / 2 - scale * (corners @ up)
    rows, columns = (slice(max(int(x.min()), 0), max(int(x.max()) + 1, 0)) for x in (down, across))
    return rows, columns


def _meet(row: Array, eye: Array, rays: Array) -> tuple[Array, NDArray[np.int64]]:
    """Multiples of `rays` (..., 3) at which they enter a box, infinity where they miss it; the side's axis."""
    matrix = rotations.matrix(row[6:10])
    start, way = (eye - row[3:6]) @ matrix, rays @ matrix
    with np.errstate(divide="ignore"):
        inverse = 1.0 / way
    one, two = (-row[:3] - start) * inverse, (row[:3] - start) * inverse
    enter = np.minimum(one, two)
    axis = enter.argmax(-1)
    first, last = enter.max(-1), np.maximum(one, two).min(-1)
    return np.where((first <= last) & (first > 0.0), first, np.inf), axis
