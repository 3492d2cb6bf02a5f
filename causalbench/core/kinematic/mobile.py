"""The kinematic hand on a base that drives among boxes, with an analytic LiDAR. It is not physics.

As `kinematic`, and in each control step, before hand and gripper move:

- the base, a cylinder, drives forward along the heading that it has half-way through its turn, and turns. It does not
  go where it would meet a fixture: that is a collision of the base, and it only turns;
- hand and held box ride on it. Where the hand would be in a fixture, base and hand stay: a collision of the arm.

The hand is a point that keeps `TABLE_CLEARANCE` from every fixture. A target of mass 0 is a mark and is never held.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic.objects import Frame, put_rows, reframed
from causalbench.core.kinematic.picture import draw
from causalbench.core.kinematic.spec import (
    BASE_HEIGHT,
    BASE_RADIUS,
    BASE_STEP,
    CONTROL_DT,
    MOBILE_SPEC,
    STEP,
    TABLE_CLEARANCE,
)
from causalbench.core.kinematic.worlds import (
    BASE_POSE,
    BOX,
    BOX_HALF,
    BOX_POSTURE,
    HAND,
    OTHER,
    OTHER_POSTURE,
    TABLE_HIT,
    Flags,
    Index,
    KinematicWorlds,
    reach_limit,
)
from causalbench.core.numerics import kernels, rotations
from causalbench.core.numerics.gufunc import broadcast
from causalbench.core.world import lidar
from causalbench.core.world.cameras import find_camera
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, box_rows
from causalbench.errors import UnreachableLayoutError

Array = NDArray[np.float64]

NOWHERE = np.array([0.0, 0.0, 0.0, 1e9, 1e9, 1e9, 1.0, 0.0, 0.0, 0.0])
"""The row of a fixture that nothing meets: worlds of a batch may have different numbers of them."""

# Columns of what a driving base adds to the state.
BASE_HIT, BASE_VELOCITY, BASE_WIDTH = 0, slice(1, 3), 3


class MobileWorlds(KinematicWorlds):
    """As `KinematicWorlds`; `base` is (*shape, BASE_WIDTH), `boxes` (*shape, n, 10) holds the fixtures."""

    spec = MOBILE_SPEC

    def __init__(self, shape: tuple[int, ...]) -> None:
        super().__init__(shape)
        self.base = np.zeros((*shape, BASE_WIDTH))
        self.boxes = np.tile(NOWHERE, (*shape, 1, 1))

    def reset(self, index: Index, layout: Layout) -> None:
        """As `KinematicWorlds.reset`."""
        super().reset(index, layout)
        self._furnish(index, layout)
        self.base[index] = 0.0
        if layout.target_mass == 0.0:
            self.state[index][BOX_HALF] = 0.0
        if _base_meets(self.boxes[index], layout.base_pose) or _in_boxes(self.boxes[index], layout.eef_position):
            raise UnreachableLayoutError(f"base at {layout.base_pose} or hand at {layout.eef_position} is in a fixture")

    def _furnish(self, index: Index, layout: Layout) -> None:
        self.boxes = put_rows(self.boxes, index, box_rows(layout.fixtures), NOWHERE)

    def _rows(self, index: Index) -> tuple[Array, ...]:
        return self.state[index], self.base[index]

    def _advance(self, actions: Array) -> None:
        self.base[...] = self.state[..., TABLE_HIT] = 0.0
        if actions[..., :2].any():
            self._drive(actions[..., :2] * BASE_STEP)
        self._move_arm((actions[..., 2:] * STEP).T)

    def _drive(self, way: Array) -> None:
        """Drive by `way` (*shape, 2) in m and rad; hand and held box ride on the base, free ones stay."""
        s, others, drives = self.state, self.others, way.any(-1)
        free, others_free = drives & ~self._holds(), drives[..., None] & ~self._holds_others()
        old = self._frame()
        self._move_base(way)
        new = self._frame()
        box, posture = reframed(old, new, s[..., BOX], s[..., BOX_POSTURE])
        s[..., BOX] = np.where(free[..., None], box, s[..., BOX])
        s[..., BOX_POSTURE] = np.where(free[..., None], posture, s[..., BOX_POSTURE])
        if others_free.any():
            box, posture = reframed(_of_each(old), _of_each(new), others[..., OTHER], others[..., OTHER_POSTURE])
            others[..., OTHER] = np.where(others_free[..., None], box, others[..., OTHER])
            others[..., OTHER_POSTURE] = np.where(others_free[..., None], posture, others[..., OTHER_POSTURE])

    def _frame(self) -> Frame:
        return self._origin(), self._heading()

    def _move_base(self, way: Array) -> None:
        s = self.state
        old = s[..., BASE_POSE].copy()
        middle = old[..., 2] + way[..., 1] / 2
        new = old + np.stack([way[..., 0] * np.cos(middle), way[..., 0] * np.sin(middle), way[..., 1]], -1)
        hit = _base_meets(self.boxes, new)
        new[..., :2] = np.where(hit[..., None], old[..., :2], new[..., :2])
        s[..., BASE_POSE] = new
        caught = _in_boxes(self.boxes, self._to_world(s[..., HAND]))
        s[..., BASE_POSE] = np.where(caught[..., None], old, new)
        self.base[..., BASE_HIT], s[..., TABLE_HIT] = hit, caught
        goes = np.stack([~hit & ~caught, ~caught], -1)
        self.base[..., BASE_VELOCITY] = goes * way / CONTROL_DT

    def _translate(self, move: Array) -> None:
        s = self.state.T
        x, y, z = s[HAND] + move
        goal = np.array([x, y, np.minimum(z, reach_limit(x))])
        blocked = _in_boxes(self.boxes, self._to_world(goal.T)).T
        s[TABLE_HIT] = blocked | (s[TABLE_HIT] > 0)
        s[HAND] = np.where(blocked, s[HAND], goal)

    def _to_world(self, point: Array) -> Array:
        return self._origin() + rotations.rotate(self._heading(), point)

    def facts(self) -> Facts:
        """What holds now, fields with leading dimensions `shape`."""
        return replace(
            super().facts(),
            base_velocity=self.base[..., BASE_VELOCITY].copy(),
            collision_base=self.base[..., BASE_HIT] > 0,
        )

    def _picture(self, index: Index, facts: Facts, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        boxes = self.boxes[index]
        fixtures, halves = boxes[boxes[:, 3] < NOWHERE[3]], self._halves(index)
        return draw(facts, fixtures, halves, True, width, height, find_camera(self.spec, camera))

    def lidar(self) -> Array:
        """Ranges (*shape, 220) in metres."""
        return lidar.scan(self.boxes, lidar.scanner_pose(self.state[..., BASE_POSE], lidar.POSITION))


def _of_each(frame: Frame) -> Frame:
    """The frames of worlds, to be used for several boxes in each."""
    origin, rotation = frame
    return origin[..., None, :], rotation[..., None, :]


def _in_boxes(boxes: Array, point: Array) -> Flags:
    """Whether `point` (..., 3) lies in one of `boxes` (..., n, 10) or nearer to it than `TABLE_CLEARANCE` permits."""
    out: Flags = _meets(boxes, point, TABLE_CLEARANCE)
    return out


def _base_meets(boxes: Array, pose: Array) -> Flags:
    """Whether the base at `pose` (..., 3) overlaps one of the upright `boxes` (..., n, 10)."""
    out: Flags = _cylinder_meets(boxes, pose, BASE_RADIUS, BASE_HEIGHT)
    return out


@broadcast("f8[:, :], f8[:], f8, b1[:]", "(n,k),(p),()->()")
def _meets(boxes: Array, point: Array, margin: float, out: Flags) -> None:
    out[0] = False
    turn = np.empty((3, 3))
    for row in range(boxes.shape[0]):
        box = boxes[row]
        kernels.matrix(box[6:10], turn)
        dx, dy, dz = point[0] - box[3], point[1] - box[4], point[2] - box[5]
        inside = True
        for axis in range(3):  # in the box's own frame
            way = turn[0, axis] * dx + turn[1, axis] * dy + turn[2, axis] * dz
            inside = inside and abs(way) < box[axis] + margin
        out[0] = out[0] or inside


@broadcast("f8[:, :], f8[:], f8, f8, b1[:]", "(n,k),(p),(),()->()")
def _cylinder_meets(boxes: Array, pose: Array, radius: float, height: float, out: Flags) -> None:
    out[0] = False
    for row in range(boxes.shape[0]):
        box = boxes[row]
        cos, sin = box[6] * box[6] - box[9] * box[9], 2 * box[6] * box[9]
        dx, dy = pose[0] - box[3], pose[1] - box[4]
        beside_x = max(abs(cos * dx + sin * dy) - box[0], 0.0)
        beside_y = max(abs(cos * dy - sin * dx) - box[1], 0.0)
        if box[5] - box[2] < height and beside_x * beside_x + beside_y * beside_y < radius * radius:
            out[0] = True
