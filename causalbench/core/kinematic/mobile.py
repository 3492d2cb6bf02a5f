"""The kinematic hand on a base that drives among boxes, with an analytic LiDAR. It is not physics.

As `kinematic`, and in each control step, before hand and gripper move:

- the base, a cylinder, drives forward along the heading that it has half-way through its turn, and turns. It does not
  go where it would meet a fixture: that is a collision of the base, and it only turns;
- hand and held box ride on it. Where the hand would be in a fixture, base and hand stay: a collision of the arm.

The hand is a point that keeps `TABLE_CLEARANCE` from every fixture. A target of mass 0 is a mark and is never held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic.picture import draw
from causalbench.core.kinematic.worlds import (
    BASE_POSE,
    BOX,
    BOX_HALF,
    BOX_POSTURE,
    HAND,
    SPEC,
    STEP,
    TABLE_CLEARANCE,
    TABLE_HIT,
    WIDTH,
    KinematicWorlds,
    reach_limit,
)
from causalbench.core.kit import base_following as driving
from causalbench.core.kit.robots.fetch import CARRY
from causalbench.core.kit.snapshots import spec_digest
from causalbench.core.numerics import kernels, rotations
from causalbench.core.numerics.gufunc import broadcast
from causalbench.core.world import lidar
from causalbench.core.world.batch import Batchable, BatchScene
from causalbench.core.world.cameras import find_camera
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene, check_action
from causalbench.errors import SnapshotError, UnreachableLayoutError

Array = NDArray[np.float64]

BASE_RADIUS, BASE_HEIGHT = 0.28, 0.40  # m, of the cylinder that carries the hand
BASE_STEP = driving.SPEED * SPEC.control_dt
MOBILE_SPEC = driving.driving_spec(SPEC, CARRY, lidar.POSITION)
SNAPSHOT_HEADER = spec_digest(MOBILE_SPEC)
NOWHERE = np.array([0.0, 0.0, 0.0, 1e9, 1e9, 1e9, 1.0, 0.0, 0.0, 0.0])
"""The row of a box that nothing meets: worlds of a batch may have different numbers of boxes."""


# Columns of what a driving base adds to the state.
BASE_HIT, BASE_VELOCITY, BASE_WIDTH = 0, slice(1, 3), 3


class MobileWorlds(KinematicWorlds):
    """As `KinematicWorlds`; `base` is (*shape, BASE_WIDTH), `boxes` (*shape, n, 10) holds the fixtures."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        super().__init__(shape)
        self.base = np.zeros((*shape, BASE_WIDTH))
        self.boxes = np.tile(NOWHERE, (*shape, 1, 1))

    def enter(self, index: tuple[int, ...], layout: Layout) -> None:
        """Put the world at `index`, () or (i,), into `layout`."""
        self._put_boxes(index, lidar.box_rows(layout.fixtures))
        self.base[index] = 0.0
        self.reset(self.state[index], layout)
        if layout.target_mass == 0.0:
            self.state[index][BOX_HALF] = 0.0
        if _base_meets(self.boxes[index], layout.base_pose) or _in_boxes(self.boxes[index], layout.eef_position):
            raise UnreachableLayoutError(f"base at {layout.base_pose} or hand at {layout.eef_position} is in a fixture")

    def _put_boxes(self, index: tuple[int, ...], rows: Array) -> None:
        more = len(rows) - self.boxes.shape[-2]
        if more > 0:
            self.boxes = np.concatenate([self.boxes, np.tile(NOWHERE, (*self.shape, more, 1))], axis=-2)
        self.boxes[index] = NOWHERE
        self.boxes[index][: len(rows)] = rows

    def pack(self, index: tuple[int, ...]) -> bytes:
        """A snapshot of the world at `index`."""
        parts = (self.state[index], self.base[index], self.boxes[index])
        return SNAPSHOT_HEADER + b"".join(part.tobytes() for part in parts)

    def unpack(self, index: tuple[int, ...], snapshot: bytes) -> None:
        """Return the world at `index` to a snapshot. Raises `SnapshotError`."""
        body = snapshot.removeprefix(SNAPSHOT_HEADER)
        n_boxes, rest = divmod(len(body) - 8 * (WIDTH + BASE_WIDTH), NOWHERE.nbytes)
        if len(body) == len(snapshot) or n_boxes < 1 or rest:
            raise SnapshotError("these bytes are not a snapshot of this version of the mobile kinematic backend")
        numbers = np.frombuffer(body)
        self.state[index], self.base[index] = numbers[:WIDTH], numbers[WIDTH : WIDTH + BASE_WIDTH]
        self._put_boxes(index, numbers[WIDTH + BASE_WIDTH :].reshape(n_boxes, len(NOWHERE)))

    def step(self, actions: Array) -> None:
        """One control step; `actions` (*shape, 9)."""
        actions = check_action(actions, (*self.shape, len(MOBILE_SPEC.actions)))
        self.base[...] = self.state[..., TABLE_HIT] = 0.0
        if actions[..., :2].any():
            self._drive(actions[..., :2] * BASE_STEP)
        self._move_arm((actions[..., 2:] * STEP).T)

    def _drive(self, way: Array) -> None:
        """Drive by `way` (*shape, 2) in m and rad; hand and held box ride on the base, a free box stays where it is."""
        s = self.state
        free = way.any(-1) & ~(self._around() & self._squeezed())
        place, posture = self._to_world(s[..., BOX]), rotations.multiply(self._heading(), s[..., BOX_POSTURE])
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
        self.base[..., BASE_VELOCITY] = goes * way / SPEC.control_dt
        back = rotations.conjugate(self._heading())
        s[..., BOX] = np.where(free[..., None], rotations.rotate(back, place - self._origin()), s[..., BOX])
        s[..., BOX_POSTURE] = np.where(free[..., None], rotations.multiply(back, posture), s[..., BOX_POSTURE])

    def _translate(self, move: Array) -> None:
        s = self.state.T
        x, y, z = s[HAND] + move
        goal = np.array([x, y, np.minimum(z, reach_limit(x))])
        blocked = _in_boxes(self.boxes, self._to_world(goal.T)).T
        s[TABLE_HIT] = blocked | (s[TABLE_HIT] > 0)
        s[HAND] = np.where(blocked, s[HAND], goal)

    def _origin(self) -> Array:
        x, y, _ = self.state.T[BASE_POSE]
        return np.array([x, y, np.zeros(self.shape)]).T

    def _heading(self) -> Array:
        yaw = self.state.T[BASE_POSE][2]
        zero = np.zeros(self.shape)
        return np.array([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)]).T

    def _to_world(self, point: Array) -> Array:
        return self._origin() + rotations.rotate(self._heading(), point)

    def facts(self) -> Facts:
        """What holds now, fields with leading dimensions `shape`."""
        return replace(
            super().facts(),
            base_velocity=self.base[..., BASE_VELOCITY].copy(),
            collision_base=self.base[..., BASE_HIT] > 0,
        )

    def _picture(self, index: tuple[int, ...], facts: Facts, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        boxes = self.boxes[index]
        fixtures = boxes[boxes[:, 3] < NOWHERE[3]]
        return draw(facts, fixtures, self.state[index][BOX_HALF], True, width, height, find_camera(MOBILE_SPEC, camera))

    def lidar(self) -> Array:
        """Ranges (*shape, 220) in metres."""
        return lidar.scan(self.boxes, lidar.scanner_pose(self.state[..., BASE_POSE], lidar.POSITION))


def _in_boxes(boxes: Array, point: Array) -> NDArray[np.bool_]:
    """Whether `point` (..., 3) lies in one of `boxes` (..., n, 10) or nearer to it than `TABLE_CLEARANCE` permits."""
    out: NDArray[np.bool_] = _meets(boxes, point, TABLE_CLEARANCE)
    return out


def _base_meets(boxes: Array, pose: Array) -> NDArray[np.bool_]:
    """Whether the base at `pose` (..., 3) overlaps one of the upright `boxes` (..., n, 10)."""
    out: NDArray[np.bool_] = _cylinder_meets(boxes, pose, BASE_RADIUS, BASE_HEIGHT)
    return out


@broadcast("f8[:, :], f8[:], f8, b1[:]", "(n,k),(p),()->()")
def _meets(boxes: Array, point: Array, margin: float, out: NDArray[np.bool_]) -> None:
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
def _cylinder_meets(boxes: Array, pose: Array, radius: float, height: float, out: NDArray[np.bool_]) -> None:
    out[0] = False
    for row in range(boxes.shape[0]):
        box = boxes[row]
        cos, sin = box[6] * box[6] - box[9] * box[9], 2 * box[6] * box[9]
        dx, dy = pose[0] - box[3], pose[1] - box[4]
        beside_x = max(abs(cos * dx + sin * dy) - box[0], 0.0)
        beside_y = max(abs(cos * dy - sin * dx) - box[1], 0.0)
        if box[5] - box[2] < height and beside_x * beside_x + beside_y * beside_y < radius * radius:
            out[0] = True


class MobileKinematicBatch(BatchScene):
    """`n` mobile kinematic worlds stepped at once."""

    def __init__(self, n: int) -> None:
        self.n, self.spec = n, MOBILE_SPEC
        self._worlds = MobileWorlds((n,))

    def reset(self, index: int, layout: Layout) -> None:
        self._worlds.enter((index,), layout)

    def step(self, actions: Array) -> None:
        self._worlds.step(actions)

    def facts(self) -> Facts:
        return self._worlds.facts()

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return self._worlds.pictures(width, height, camera)

    def lidar(self) -> Array:
        return self._worlds.lidar()

    def snapshots(self) -> list[bytes]:
        return [self._worlds.pack((i,)) for i in range(self.n)]

    def restore(self, snapshots: Sequence[bytes]) -> None:
        for i, snapshot in enumerate(snapshots):
            self._worlds.unpack((i,), snapshot)

    def close(self) -> None:
        """Nothing to release."""


class MobileKinematicScene(Scene, Batchable):
    """One mobile kinematic world."""

    def __init__(self) -> None:
        self.spec = MOBILE_SPEC
        self._world = MobileWorlds(())

    def batch(self, n: int) -> MobileKinematicBatch:
        return MobileKinematicBatch(n)

    def reset(self, layout: Layout) -> None:
        self._world.enter((), layout)

    def step(self, action: Array) -> None:
        self._world.step(action)

    def facts(self) -> Facts:
        return self._world.facts()

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return self._world.pictures(width, height, camera)

    def lidar(self) -> Array:
        return self._world.lidar()

    def snapshot(self) -> bytes:
        return self._world.pack(())

    def restore(self, snapshot: bytes) -> None:
        self._world.unpack((), snapshot)
