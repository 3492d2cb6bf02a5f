"""The kinematic reference backend: a floating hand with a reach limit, in numpy. It is not physics.

Everything is known in closed form. In the robot base frame, with d = speed * control_dt * action:

- the gripper acts first, at the pose before the motion: the commanded opening c <- clip(c - d_grip, 0, max);
  if the hand is around the box, the opening is max(c, box width) and the box is held once c is `SQUEEZE`
  below its width;
- the hand then moves by (d_armx, d_army, d_armz) and turns by Rx(d_armrx) Ry(d_armry) Rz(d_armrz) about its own
  axes; a held box moves with it;
- the arm's reach limits height: z <= SHOULDER_HEIGHT + sqrt(REACH^2 - x^2), applied after x has moved. So on the
  limit armx lowers z, and armx is a cause of a z reward just where starts lie on the limit. The limit is planar
  (it ignores y) so that army never is;
- the table stops the hand: that is a collision of the arm.

Hence the true causes of pure manipulation: stage 1 r_eefx {army}, r_eefy {armx}, r_eefz1 {armx, armz}; stage 2
r_ori {armrx, armry}; stage 3 r_eefz2 {armz}; r_gripper {grip} in all four.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic.picture import draw
from causalbench.core.kit.snapshots import spec_digest
from causalbench.core.numerics import rotations
from causalbench.core.world.batch import Batchable, BatchScene, select
from causalbench.core.world.cameras import find_camera
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.core.world.scene import ACTION_SPEED, ARM_ACTIONS, Scene, SceneSpec, check_action
from causalbench.errors import SnapshotError, UnreachableLayoutError

Array = NDArray[np.float64]

CONTROL_DT = 0.1  # s
SHOULDER_HEIGHT = 0.70  # m
REACH = 0.82  # m
MAX_OPENING = 0.10  # m
SQUEEZE = 0.005  # m by which the commanded opening must undercut the box's width for the box to be held
TABLE_CLEARANCE = 0.005  # m between the table and the lowest hand
AROUND = (0.05, 0.05, 0.03)  # m, hand frame: the box centre this near lies between the fingers
TABLE_HALF, TABLE_MIDDLE = (0.3, 0.5), 0.78  # m, of its picture: half extents, middle ahead of the base
UPRIGHT = 0.3  # rad from straight down within which the fingers can enclose the box

WORKSPACE = Workspace(
    table_height=0.70,
    object_low=(0.58, -0.15),
    object_high=(0.70, 0.15),
    hand_low=(0.69, -0.20, 1.00),
    hand_high=(0.77, 0.20, 1.13),
)
SPEC = SceneSpec(
    backend="kinematic",
    backend_version="1",
    engine="numpy",
    engine_version="1",  # the closed form above, not numpy's release
    robot="floating hand",
    actions=ARM_ACTIONS,
    action_speed=tuple(ACTION_SPEED[a] for a in ARM_ACTIONS),
    workspace=WORKSPACE,
    max_opening=MAX_OPENING,
    control_dt=CONTROL_DT,
    timestep=CONTROL_DT,
    capabilities=frozenset({Capability.EXACT_RESTORE, Capability.RGB}),
)
STEP = np.array(SPEC.action_speed) * CONTROL_DT
SNAPSHOT_HEADER = spec_digest(SPEC)

# Columns of the state, one row per world, robot base frame.
HAND, POSTURE, COMMAND, BOX, BOX_POSTURE = slice(0, 3), slice(3, 7), 7, slice(8, 11), slice(11, 15)
BASE_POSE, BOX_HALF, TABLE_HIT, TABLE_TOP = slice(15, 18), slice(18, 21), 21, 22
WIDTH = 23


def reach_limit(x: Array) -> Array:
    """Greatest height (...) in metres of the hand at base-frame distance x (...)."""
    return SHOULDER_HEIGHT + np.sqrt(np.maximum(REACH * REACH - x * x, 0.0))


class KinematicWorlds:
    """Kinematic worlds of leading `shape` () or (n,). `state` is (*shape, WIDTH) float64; `.T` unpacks its columns."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self.state = np.zeros((*shape, WIDTH))
        self.state[..., POSTURE.start] = self.state[..., BOX_POSTURE.start] = 1.0

    def reset(self, row: Array, layout: Layout) -> None:
        """Put the world whose state is the view `row` (WIDTH,) into `layout`."""
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

    def step(self, actions: Array) -> None:
        """One control step; `actions` (*shape, 7)."""
        self._move_arm((check_action(actions, (*self.shape, len(ARM_ACTIONS))) * STEP).T)

    def _move_arm(self, move: Array) -> None:
        """Move hand and gripper by `move` (7, *shape) in m and rad, as the module says."""
        s = self.state.T
        s[COMMAND] = np.minimum(np.maximum(s[COMMAND] - move[6], 0.0), MAX_OPENING)
        held = self._around() & self._squeezed()
        old = self.state.copy()
        self._translate(move[:3])
        s[POSTURE] = rotations.canonical(
            rotations.multiply(self.state[..., POSTURE], rotations.from_own_angles(move[3:6].T))
        ).T
        if held.any():
            self._carry(held, old)

    def _translate(self, move: Array) -> None:
        """Move the hand by `move` (3, *shape) as far as reach and table let it."""
        s = self.state.T
        x, y, z = s[HAND] + move
        floor = s[TABLE_TOP] + TABLE_CLEARANCE
        z = np.minimum(z, reach_limit(x))
        s[TABLE_HIT] = z < floor
        s[HAND] = x, y, np.maximum(z, floor)

    def _squeezed(self) -> NDArray[np.bool_]:
        """(*shape) whether the command undercuts the box's width."""
        s = self.state.T
        return s[COMMAND] < 2 * s[BOX_HALF.start + 1] - SQUEEZE

    def _around(self) -> NDArray[np.bool_]:
        """(*shape) whether the box lies between the fingers."""
        posture = self.state[..., POSTURE]
        _, x, y, _ = posture.T
        offset = self.state[..., BOX] - self.state[..., HAND]
        dx, dy, dz = rotations.rotate(rotations.conjugate(posture), offset).T
        between = (abs(dx) < AROUND[0]) & (abs(dy) < AROUND[1]) & (abs(dz) < AROUND[2])
        return between & (2 * (x * x + y * y) - 1 > math.cos(UPRIGHT))

    def _carry(self, held: NDArray[np.bool_], old: Array) -> None:
        """Move the boxes that are held (*shape) as the hands moved since the state `old`."""
        s = self.state
        turn = rotations.multiply(s[..., POSTURE], rotations.conjugate(old[..., POSTURE]))
        box = s[..., HAND] + rotations.rotate(turn, s[..., BOX] - old[..., HAND])
        s[..., BOX] = np.where(held[..., None], box, s[..., BOX])
        posture = rotations.multiply(turn, s[..., BOX_POSTURE])
        s[..., BOX_POSTURE] = np.where(held[..., None], posture, s[..., BOX_POSTURE])

    def facts(self) -> Facts:
        """What holds now, fields with leading dimensions `shape`."""
        s = self.state.T
        x, y, yaw = s[BASE_POSE]
        cos, sin, zero = np.cos(yaw / 2), np.sin(yaw / 2), np.zeros(self.shape)
        turn, origin = np.array([cos, zero, zero, sin]).T, np.array([x, y, zero]).T
        around, width, opening = self._around(), 2 * s[BOX_HALF.start + 1], s[COMMAND]
        no = np.zeros(self.shape, dtype=bool)
        return Facts(
            eef_position=origin + rotations.rotate(turn, s[HAND].T),
            eef_quaternion=rotations.canonical(rotations.multiply(turn, s[POSTURE].T)),
            gripper_opening=np.where(around, np.maximum(opening, width), opening),
            holding=around & self._squeezed(),
            object_position=origin + rotations.rotate(turn, s[BOX].T),
            object_quaternion=rotations.canonical(rotations.multiply(turn, s[BOX_POSTURE].T)),
            base_pose=s[BASE_POSE].T.copy(),
            base_velocity=np.zeros((*self.shape, 2)),
            collision_base=no,
            collision_arm=s[TABLE_HIT] > 0,
            collision_self=no.copy(),
        )

    def pictures(self, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        """RGB images (*shape, height, width, 3). The table, which is everywhere, is drawn as large as the task's."""
        facts, out = self.facts(), np.empty((*self.shape, height, width, 3), np.uint8)
        for index in np.ndindex(self.shape):
            out[index] = self._picture(index, select(facts, index), width, height, camera)
        return out

    def _picture(self, index: tuple[int, ...], facts: Facts, width: int, height: int, camera: str) -> NDArray[np.uint8]:
        state = self.state[index]
        x, y, yaw = state[BASE_POSE]
        turn, half = rotations.from_axis_angle(2, yaw), np.array([*TABLE_HALF, state[TABLE_TOP] / 2])
        middle = np.array([x, y, 0.0]) + rotations.rotate(turn, np.array([TABLE_MIDDLE, 0.0, half[2]]))
        table = np.concatenate([half, middle, turn])[None]
        return draw(facts, table, state[BOX_HALF], False, width, height, find_camera(SPEC, camera))


class KinematicBatch(BatchScene):
    """`n` kinematic worlds stepped at once."""

    def __init__(self, n: int) -> None:
        self.n, self.spec = n, SPEC
        self._worlds = KinematicWorlds((n,))

    def reset(self, index: int, layout: Layout) -> None:
        self._worlds.reset(self._worlds.state[index], layout)

    def step(self, actions: Array) -> None:
        self._worlds.step(actions)

    def facts(self) -> Facts:
        return self._worlds.facts()

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return self._worlds.pictures(width, height, camera)

    def snapshots(self) -> list[bytes]:
        return [_pack(row) for row in self._worlds.state]

    def restore(self, snapshots: Sequence[bytes]) -> None:
        self._worlds.state[:] = [_unpack(snapshot) for snapshot in snapshots]

    def close(self) -> None:
        """Nothing to release."""


class KinematicScene(Scene, Batchable):
    """One kinematic world."""

    def __init__(self) -> None:
        self.spec = SPEC
        self._world = KinematicWorlds(())

    def batch(self, n: int) -> KinematicBatch:
        return KinematicBatch(n)

    def reset(self, layout: Layout) -> None:
        self._world.reset(self._world.state, layout)

    def step(self, action: Array) -> None:
        self._world.step(action)

    def facts(self) -> Facts:
        return self._world.facts()

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return self._world.pictures(width, height, camera)

    def snapshot(self) -> bytes:
        return _pack(self._world.state)

    def restore(self, snapshot: bytes) -> None:
        self._world.state[:] = _unpack(snapshot)


def _pack(row: Array) -> bytes:
    return SNAPSHOT_HEADER + row.tobytes()


def _unpack(snapshot: bytes) -> Array:
    state = snapshot.removeprefix(SNAPSHOT_HEADER)
    if len(state) == len(snapshot) or len(state) != WIDTH * np.dtype(np.float64).itemsize:
        raise SnapshotError("these bytes are not a snapshot of this version of the kinematic backend")
    return np.frombuffer(state)
