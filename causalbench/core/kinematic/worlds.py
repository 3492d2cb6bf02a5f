"""The kinematic reference backend: a floating hand with a reach limit, in numpy. It is not physics.

Everything is known in closed form. In the robot base frame, with d = speed * control_dt * action:

- the gripper acts first, at the pose before the motion: the commanded opening c <- clip(c - d_grip, 0, max);
  if the hand is around a box, the opening is max(c, box width) and the box is held once c is `SQUEEZE`
  below its width;
- the hand then moves by (d_armx, d_army, d_armz) and turns by Rx(d_armrx) Ry(d_armry) Rz(d_armrz) about its own
  axes; a held box moves with it, and every other one rests where it is;
- the arm's reach limits height: z <= SHOULDER_HEIGHT + sqrt(REACH^2 - x^2), applied after x has moved. So on the
  limit armx lowers z, and armx is a cause of a z reward just where starts lie on the limit. The limit is planar
  (it ignores y) so that army never is;
- the table stops the hand: that is a collision of the arm.

Hence the true causes of pure manipulation: stage 1 r_eefx {army}, r_eefy {armx}, r_eefz1 {armx, armz}; stage 2
r_ori {armrx, armry}; stage 3 r_eefz2 {armz}; r_gripper {grip} in all four.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic.objects import carried, enclosed, put_rows
from causalbench.core.kinematic.picture import draw
from causalbench.core.kinematic.spec import (
    MAX_OPENING,
    REACH,
    SHOULDER_HEIGHT,
    SPEC,
    SQUEEZE,
    STEP,
    TABLE_CLEARANCE,
    TABLE_HALF,
    TABLE_MIDDLE,
)
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.numerics import rotations
from causalbench.core.world.batch import select
from causalbench.core.world.cameras import find_camera
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import NO_POSITIONS, NO_QUATERNIONS, Facts
from causalbench.core.world.layout import Layout, box_rows
from causalbench.core.world.scene import check_action, check_layout, lacking
from causalbench.errors import CausalbenchError, SnapshotError, UnreachableLayoutError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = tuple[int, ...]  # of a world: () for the only one, (i,) in a batch

# Columns of the state, one row per world, robot base frame.
HAND, POSTURE, COMMAND, BOX, BOX_POSTURE = slice(0, 3), slice(3, 7), 7, slice(8, 11), slice(11, 15)
BASE_POSE, BOX_HALF, TABLE_HIT, TABLE_TOP = slice(15, 18), slice(18, 21), 21, 22
WIDTH = 23

# Columns of the boxes beside the target, robot base frame, in the order of `box_rows`.
OTHER_WIDTH, OTHER, OTHER_POSTURE = 1, slice(3, 6), slice(6, 10)
NO_OTHER, POSE = np.full(10, np.nan), 7


def reach_limit(x: Array) -> Array:
    """Greatest height (...) in metres of the hand at base-frame distance x (...)."""
    return SHOULDER_HEIGHT + np.sqrt(np.maximum(REACH * REACH - x * x, 0.0))


class KinematicWorlds:
    """Kinematic worlds of leading `shape` () or (n,).

    `state` is (*shape, WIDTH) float64, `others` (*shape, n_others, 10); `.T` unpacks their columns. `layouts` are the
    starts of the worlds that were reset or restored.
    """

    spec = SPEC

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self.state = np.zeros((*shape, WIDTH))
        self.state[..., POSTURE.start] = self.state[..., BOX_POSTURE.start] = 1.0
        self.others = np.empty((*shape, 0, len(NO_OTHER)))
        self.layouts: dict[Index, Layout] = {}
        self._codec = SnapshotCodec(self.spec)

    def reset(self, index: Index, layout: Layout) -> None:
        """Put the world at `index` into `layout`. Raises `UnreachableLayoutError`."""
        check_layout(layout, self.spec)
        row = self.state[index]
        x, y, yaw = layout.base_pose
        unturn = rotations.from_axis_angle(2, -yaw)
        origin = np.array([x, y, 0.0])
        hand = rotations.rotate(unturn, layout.eef_position - origin)
        if hand[2] > reach_limit(hand[0]):
            raise UnreachableLayoutError(
                f"hand at {hand} (base frame) lies above the reach limit {reach_limit(hand[0])}"
            )
        row[HAND] = hand
        row[POSTURE] = rotations.multiply(unturn, layout.eef_quaternion)
        row[COMMAND] = layout.gripper_opening
        row[BOX] = rotations.rotate(unturn, layout.target.position - origin)
        row[BOX_POSTURE] = rotations.multiply(unturn, layout.target.quaternion)
        row[BASE_POSE] = layout.base_pose
        row[BOX_HALF] = layout.target.half_extents
        row[TABLE_HIT] = 0.0
        row[TABLE_TOP] = max(box.position[2] + box.half_extents[2] for box in layout.fixtures)
        others = box_rows(layout.others)
        others[:, OTHER] = rotations.rotate(unturn, others[:, OTHER] - origin)
        others[:, OTHER_POSTURE] = rotations.multiply(unturn, others[:, OTHER_POSTURE])
        self.others = put_rows(self.others, index, others, NO_OTHER)
        self.layouts[index] = layout

    def step(self, actions: Array) -> None:
        """One control step; `actions` (*shape, n_actions) in [-1, 1]. Raises `InvalidActionError`."""
        self._advance(check_action(actions, (*self.shape, len(self.spec.actions))))

    def _advance(self, actions: Array) -> None:
        self._move_arm((actions * STEP).T)

    def _move_arm(self, move: Array) -> None:
        """Move hand and gripper by `move` (7, *shape) in m and rad, as the module says."""
        s = self.state.T
        s[COMMAND] = np.minimum(np.maximum(s[COMMAND] - move[6], 0.0), MAX_OPENING)
        held, others_held = self._holds(), self._holds_others()
        old = self.state.copy()
        self._translate(move[:3])
        s[POSTURE] = rotations.canonical(
            rotations.multiply(self.state[..., POSTURE], rotations.from_own_angles(move[3:6].T))
        ).T
        if held.any():
            self._carry(held, old)
        if others_held.any():
            self._carry_others(others_held, old)

    def _translate(self, move: Array) -> None:
        """Move the hand by `move` (3, *shape) as far as reach and table let it."""
        s = self.state.T
        x, y, z = s[HAND] + move
        floor = s[TABLE_TOP] + TABLE_CLEARANCE
        z = np.minimum(z, reach_limit(x))
        s[TABLE_HIT] = z < floor
        s[HAND] = x, y, np.maximum(z, floor)

    def _around(self) -> Flags:
        """(*shape) whether the target lies between the fingers."""
        s = self.state
        return enclosed(s[..., HAND], s[..., POSTURE], s[..., BOX])

    def _around_others(self) -> Flags:
        """(*shape, n_others) whether the other boxes lie between the fingers."""
        s = self.state[..., None, :]
        return enclosed(s[..., HAND], s[..., POSTURE], self.others[..., OTHER])

    def _holds(self) -> Flags:
        """(*shape) whether the target is held."""
        s = self.state.T
        return self._around() & (s[COMMAND] < 2 * s[BOX_HALF.start + 1] - SQUEEZE)

    def _holds_others(self) -> Flags:
        """(*shape, n_others) whether the other boxes are held."""
        if not self.others.size:
            return np.zeros(self.others.shape[:-1], dtype=np.bool_)
        squeezed = self.state[..., COMMAND, None] < 2 * self.others[..., OTHER_WIDTH] - SQUEEZE
        return self._around_others() & squeezed

    def _carry(self, held: Flags, old: Array) -> None:
        """Move the targets that are held (*shape) as the hands moved since the state `old`."""
        s = self.state
        turn = rotations.multiply(s[..., POSTURE], rotations.conjugate(old[..., POSTURE]))
        box, posture = carried(turn, s[..., HAND], old[..., HAND], s[..., BOX], s[..., BOX_POSTURE])
        s[..., BOX] = np.where(held[..., None], box, s[..., BOX])
        s[..., BOX_POSTURE] = np.where(held[..., None], posture, s[..., BOX_POSTURE])

    def _carry_others(self, held: Flags, old: Array) -> None:
        """As `_carry`, the other boxes (*shape, n_others)."""
        s, old, others = self.state[..., None, :], old[..., None, :], self.others
        turn = rotations.multiply(s[..., POSTURE], rotations.conjugate(old[..., POSTURE]))
        box, posture = carried(turn, s[..., HAND], old[..., HAND], others[..., OTHER], others[..., OTHER_POSTURE])
        others[..., OTHER] = np.where(held[..., None], box, others[..., OTHER])
        others[..., OTHER_POSTURE] = np.where(held[..., None], posture, others[..., OTHER_POSTURE])

    def _origin(self) -> Array:
        """(*shape, 3) the base's place on the floor, world frame."""
        x, y, _ = self.state.T[BASE_POSE]
        return np.array([x, y, np.zeros(self.shape)]).T

    def _heading(self) -> Array:
        """(*shape, 4) the base's rotation in the world."""
        yaw = self.state.T[BASE_POSE][2]
        zero = np.zeros(self.shape)
        return np.array([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)]).T

    def facts(self) -> Facts:
        """What holds now, fields with leading dimensions `shape`."""
        s = self.state.T
        turn, origin = self._heading(), self._origin()
        around, width, opening = self._around(), 2 * s[BOX_HALF.start + 1], s[COMMAND]
        no = np.zeros(self.shape, dtype=bool)
        positions, quaternions = self._poses_of_others(origin, turn)
        opening = np.where(around, np.maximum(opening, width), opening)
        return Facts(
            eef_position=origin + rotations.rotate(turn, s[HAND].T),
            eef_quaternion=rotations.canonical(rotations.multiply(turn, s[POSTURE].T)),
            gripper_opening=self._widened(opening),
            holding=around & (s[COMMAND] < width - SQUEEZE),
            object_position=origin + rotations.rotate(turn, s[BOX].T),
            object_quaternion=rotations.canonical(rotations.multiply(turn, s[BOX_POSTURE].T)),
            base_pose=s[BASE_POSE].T.copy(),
            base_velocity=np.zeros((*self.shape, 2)),
            collision_base=no,
            collision_arm=s[TABLE_HIT] > 0,
            collision_self=no.copy(),
            other_positions=positions,
            other_quaternions=quaternions,
        )

    def _widened(self, opening: Array) -> Array:
        """`opening` (*shape), at least the width of every other box between the fingers."""
        if not self.others.size:
            return opening
        width = np.where(self._around_others(), 2 * self.others[..., OTHER_WIDTH], 0.0)
        return np.maximum(opening, width.max(-1))

    def _poses_of_others(self, origin: Array, turn: Array) -> tuple[Array, Array]:
        if not self.others.size:
            return NO_POSITIONS, NO_QUATERNIONS
        origin, turn = origin[..., None, :], turn[..., None, :]
        posture = rotations.canonical(rotations.multiply(turn, self.others[..., OTHER_POSTURE]))
        return origin + rotations.rotate(turn, self.others[..., OTHER]), posture

    def snapshot(self, index: Index) -> bytes:
        """The whole world at `index`. Raises `CausalbenchError` before its first reset."""
        if index not in self.layouts:
            raise CausalbenchError("call reset() before snapshot()")
        layout = self.layouts[index]
        others = self.others[index][: len(layout.others), OTHER.start :]
        return self._codec.pack(layout, np.concatenate([*self._rows(index), others.ravel()]).tobytes())

    def restore(self, index: Index, snapshot: bytes) -> None:
        """Return the world at `index` to a snapshot. Raises `SnapshotError`."""
        layout, packed = self._codec.unpack(snapshot)
        numbers, others = np.frombuffer(packed), box_rows(layout.others)
        rows = self._rows(index)
        if len(numbers) != sum(map(len, rows)) + POSE * len(others):
            raise SnapshotError("these bytes are not a snapshot of this version of the kinematic backend")
        for row in rows:
            row[:], numbers = numbers[: len(row)], numbers[len(row) :]
        others[:, OTHER.start :] = numbers.reshape(len(others), POSE)
        self.others = put_rows(self.others, index, others, NO_OTHER)
        if self.layouts.get(index) is not layout:
            self._furnish(index, layout)
            self.layouts[index] = layout

    def _rows(self, index: Index) -> tuple[Array, ...]:
        """Views of all that changes in the world at `index` but for the other boxes."""
        return (self.state[index],)

    def _furnish(self, index: Index, layout: Layout) -> None:
        """Give the world at `index` the fixtures of `layout`; here the table's height in the state is all of them."""

    def pictures(self, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        """RGB images (*shape, height, width, 3). The table, which is everywhere, is drawn as large as the task's."""
        facts, out = self.facts(), np.empty((*self.shape, height, width, 3), np.uint8)
        for index in np.ndindex(self.shape):
            out[index] = self._picture(index, select(facts, index), width, height, camera)
        return out

    def _picture(self, index: Index, facts: Facts, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        state = self.state[index]
        x, y, yaw = state[BASE_POSE]
        turn, half = rotations.from_axis_angle(2, yaw), np.array([*TABLE_HALF, state[TABLE_TOP] / 2])
        middle = np.array([x, y, 0.0]) + rotations.rotate(turn, np.array([TABLE_MIDDLE, 0.0, half[2]]))
        table = np.concatenate([half, middle, turn])[None]
        return draw(facts, table, self._halves(index), False, width, height, find_camera(self.spec, camera))

    def _halves(self, index: Index) -> Array:
        """(1 + n_others, 3) half extents of the target and of the other boxes, NaN for those that others have."""
        return np.vstack([self.state[index][BOX_HALF], self.others[index][:, : OTHER.start]])

    def lidar(self) -> Array:
        """Ranges (*shape, 220) in metres. Raises `CausalbenchError` where there is no scanner."""
        raise lacking(self.spec, Capability.LIDAR)
