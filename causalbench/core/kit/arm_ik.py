"""Kinematics of a serial arm with hinge joints: poses, the macro actions' joint targets, and full solutions.

Simulator-free and compiled (`causalbench.core.numerics.compiled`). All poses are in the frame the chain starts in: for
a robot its base frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.numerics.compiled import compiled
from causalbench.core.world.layout import Layout
from causalbench.errors import UnreachableLayoutError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DAMPING = 2e-4  # of the least squares, rotations weighted
ROTATION_WEIGHT = 0.3  # m: an error of one radian counts as much as one of 0.3 m
MAX_JOINT_SPEED = 1.5  # rad/s of a joint target: what servos with 0.04 s of lag follow within LEAD
LEAD = 0.10  # rad by which a joint target may lie off the measured joint: bounds force and wind-up
ITERATIONS = 2  # per control step; with one alone the hand drifts while it turns
FREEZES = 3  # passes in which joints at a limit are taken out of the least squares

SOLVE_DAMPING = 1e-3
SOLVE_ITERATIONS = 200
SOLVE_STRIDE = 0.3  # norm of the largest pose error that one iteration of a full solution works on
SOLVE_ERROR = 1e-4  # norm of the pose error (m, rad) below which a solution counts


class Chain(NamedTuple):
    """n hinge joints. Joint i turns its link about `axes[i]` after the fixed transform (`rotations[i]`, `offsets[i]`).

    The last fixed transform leads from the last link to the end effector. rotations (n + 1, 3, 3),
    offsets (n + 1, 3) m, axes (n, 3) unit vectors, limits (n, 2) rad, infinite where there are none.
    """

    rotations: Array
    offsets: Array
    axes: Array
    limits: Array


def chain_at_zero(anchors: Array, axes: Array, limits: Array, position: Array, rotation: Array) -> Chain:
    """The chain of an arm whose joints are all at 0, from what any simulator tells about it there.

    `anchors` (n, 3) m are points on the joints' axes and `axes` (n, 3) their unit directions; `position` (3,) and
    `rotation` (3, 3) are the pose of the end effector, its z along the approach axis and its y along the closing
    axis; all in the frame that the chain shall have, for a robot its base frame. `limits` (n, 2) rad.
    """
    points = np.vstack([np.zeros(3), anchors, position])
    turns = np.tile(np.eye(3), (len(anchors) + 1, 1, 1))
    turns[-1] = rotation
    return Chain(turns, np.diff(points, axis=0), np.array(axes, dtype=np.float64), np.array(limits, dtype=np.float64))


@compiled
def axis_rotation(axis: Array, angle: float, out: Array) -> None:
    """`out` (3, 3) = the rotation by `angle` about the unit vector `axis` (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@compiled
def matmul(a: Array, b: Array, out: Array) -> None:
    """`out` = a b for 3 x 3 matrices; `out` may be neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled
def rotation_error(target: Array, actual: Array, out: Array) -> None:
    """`out` (3,) = rotation vector that turns the matrix `actual` into `target`, in the chain's frame."""
    r = np.empty((3, 3))
    matmul(target, actual.T, r)
    out[0], out[1], out[2] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    sine2 = np.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    cosine2 = r[0, 0] + r[1, 1] + r[2, 2] - 1.0
    if sine2 < 1e-9 and cosine2 < 0.0:
        # Half a turn: the skew part vanishes. The axis is a column of r + 1.
        k = np.argmax(np.array([r[0, 0], r[1, 1], r[2, 2]]))
        axis = r[:, k].copy()
        axis[k] += 1.0
        out[:] = axis * (np.pi / np.sqrt((axis * axis).sum()))
        return
    scale = 0.5 if sine2 < 1e-9 else np.arctan2(sine2, cosine2) / sine2
    for i in range(3):
        out[i] *= scale


@compiled
def forward(chain: Chain, q: Array, position: Array, rotation: Array, jacobian: Array) -> None:
    """Pose and Jacobian at the joint angles `q` (n,).

    Fills `position` (3,), `rotation` (3, 3) and `jacobian` (6, n): three rows of linear, three of angular velocity.
    """
    n = q.shape[0]
    at, axes = np.empty((n, 3)), np.empty((n, 3))
    turn, work = np.empty((3, 3)), np.empty((3, 3))
    position[:] = chain.offsets[0]
    rotation[:] = chain.rotations[0]
    for i in range(n):
        at[i] = position
        for r in range(3):
            axes[i, r] = (
                rotation[r, 0] * chain.axes[i, 0]
                + rotation[r, 1] * chain.axes[i, 1]
                + rotation[r, 2] * chain.axes[i, 2]
            )
        axis_rotation(chain.axes[i], q[i], turn)
        matmul(rotation, turn, work)
        for r in range(3):
            offset = chain.offsets[i + 1]
            position[r] += work[r, 0] * offset[0] + work[r, 1] * offset[1] + work[r, 2] * offset[2]
        matmul(work, chain.rotations[i + 1], rotation)
    for i in range(n):
        x, y, z = position[0] - at[i, 0], position[1] - at[i, 1], position[2] - at[i, 2]
        jacobian[0, i] = axes[i, 1] * z - axes[i, 2] * y
        jacobian[1, i] = axes[i, 2] * x - axes[i, 0] * z
        jacobian[2, i] = axes[i, 0] * y - axes[i, 1] * x
        jacobian[3:, i] = axes[i]


@compiled
def _least_squares(jacobian: Array, free: Mask, twist: Array, damping: float, dq: Array) -> None:
    """`dq` (n,) = J^T (J J^T + damping)^-1 twist over the free columns, 0 elsewhere."""
    a, x = np.empty((6, 6)), np.empty(6)
    n = dq.shape[0]
    for i in range(6):
        for j in range(i + 1):
            s = damping if i == j else 0.0
            for k in range(n):
                if free[k]:
                    s += jacobian[i, k] * jacobian[j, k]
            for k in range(j):  # Cholesky, row by row
                s -= a[i, k] * a[j, k]
            a[i, j] = np.sqrt(s) if i == j else s / a[j, j]
    for i in range(6):
        s = twist[i]
        for k in range(i):
            s -= a[i, k] * x[k]
        x[i] = s / a[i, i]
    for i in range(5, -1, -1):
        s = x[i]
        for k in range(i + 1, 6):
            s -= a[k, i] * x[k]
        x[i] = s / a[i, i]
    for k in range(n):
        s = 0.0
        if free[k]:
            for i in range(6):
                s += jacobian[i, k] * x[i]
        dq[k] = s


@compiled
def _limited_least_squares(
    jacobian: Array, q: Array, limits: Array, twist: Array, damping: float, free: Mask, dq: Array
) -> None:
    """As `_least_squares`, but a joint that would cross a limit is frozen and the rest solved again."""
    free[:] = True
    for _ in range(FREEZES):
        _least_squares(jacobian, free, twist, damping, dq)
        frozen = False
        for k in range(q.shape[0]):
            goal = q[k] + dq[k]
            if free[k] and ((goal < limits[k, 0] and dq[k] < 0) or (goal > limits[k, 1] and dq[k] > 0)):
                free[k] = False
                frozen = True
        if not frozen:
            return


@compiled
def _displace(
    position: Array, rotation: Array, delta: Array, share: float, goal_position: Array, goal_rotation: Array
) -> None:
    """The goal (3,), (3, 3) = the pose (3,), (3, 3) moved by `share` of `delta` (6,), see `follow`."""
    turn = np.empty((3, 3))
    angle = np.sqrt(delta[3] * delta[3] + delta[4] * delta[4] + delta[5] * delta[5])
    axis_rotation(delta[3:] / max(angle, 1e-12), angle * share, turn)
    matmul(rotation, turn, goal_rotation)
    goal_position[:] = position + delta[:3] * share


@compiled
def follow(chain: Chain, target: Array, measured: Array, delta: Array, dt: float) -> None:
    """Move the joint targets by one control step of the macro actions, in place.

    The hand's reference pose is that of `target` (n,) rad plus `delta` (6,): metres along the chain's axes and
    radians about the end effector's own axes. It does not depend on where the arm is, so nothing drifts. The
    new target stays within the joint limits and within `LEAD` of the `measured` joints (n,).
    """
    n = target.shape[0]
    moving = False
    for i in range(6):
        moving = moving or delta[i] != 0.0
    if moving:
        start, dq, free = target.copy(), np.empty(n), np.empty(n, np.bool_)
        position, rotation, jacobian, twist = np.empty(3), np.empty((3, 3)), np.empty((6, n)), np.empty(6)
        goal_position, goal_rotation = np.empty(3), np.empty((3, 3))
        for iteration in range(ITERATIONS):
            forward(chain, target, position, rotation, jacobian)
            if iteration == 0:
                twist[:3] = delta[:3]
                for i in range(3):
                    twist[3 + i] = rotation[i, 0] * delta[3] + rotation[i, 1] * delta[4] + rotation[i, 2] * delta[5]
            else:
                twist[:3] = goal_position - position
                rotation_error(goal_rotation, rotation, twist[3:])
            twist[3:] *= ROTATION_WEIGHT
            jacobian[3:] *= ROTATION_WEIGHT
            _limited_least_squares(jacobian, target, chain.limits, twist, DAMPING, free, dq)
            slower = 1.0 / max(np.abs(dq).max() / (MAX_JOINT_SPEED * dt), 1.0)
            if iteration == 0:
                # Joints too slow for the action slow the hand down on its way; they do not bend the way.
                _displace(position, rotation, delta, slower, goal_position, goal_rotation)
            for k in range(n):
                target[k] = min(max(target[k] + dq[k] * slower, chain.limits[k, 0]), chain.limits[k, 1])
        slower = 1.0 / max(np.abs(target - start).max() / (MAX_JOINT_SPEED * dt), 1.0)
        for k in range(n):
            target[k] = start[k] + (target[k] - start[k]) * slower
    for k in range(n):
        target[k] = min(max(target[k], measured[k] - LEAD), measured[k] + LEAD)


@compiled
def _solve(chain: Chain, goal_position: Array, goal_rotation: Array, q: Array) -> float:
    """Move `q` (n,) in place to the goal pose; the norm of the remaining pose error."""
    n = q.shape[0]
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, n))
    twist, dq, free = np.empty(6), np.empty(n), np.empty(n, np.bool_)
    error = np.inf
    for _ in range(SOLVE_ITERATIONS):
        forward(chain, q, position, rotation, jacobian)
        twist[:3] = goal_position - position
        rotation_error(goal_rotation, rotation, twist[3:])
        error = np.sqrt((twist * twist).sum())
        if error < 0.1 * SOLVE_ERROR:
            break
        twist *= min(1.0, SOLVE_STRIDE / error)
        _limited_least_squares(jacobian, q, chain.limits, twist, SOLVE_DAMPING, free, dq)
        for k in range(n):
            q[k] = min(max(q[k] + dq[k], chain.limits[k, 0]), chain.limits[k, 1])
    return error


def solve(chain: Chain, position: Array, rotation: Array, starts: Iterable[Array]) -> Array:
    """Joint angles (n,) at which the end effector has `position` (3,) and `rotation` (3, 3), to `SOLVE_ERROR`.

    Searches from each of the `starts` (n,) in turn, so equal arguments give equal joints, whatever came before.
    Raises `UnreachableLayoutError`.
    """
    position, rotation = np.ascontiguousarray(position), np.ascontiguousarray(rotation)
    best = np.inf
    for start in starts:
        q = np.array(start, dtype=np.float64)
        error = _solve(chain, position, rotation, q)
        if error < SOLVE_ERROR:
            return q
        best = min(best, error)
    raise UnreachableLayoutError(f"the arm cannot take the pose at {position} (base frame): it stays {best:.2g} off")


def reach(chain: Chain, layout: Layout, starts: Iterable[Array]) -> Array:
    """Joint angles (n,) for the hand of `layout`, the chain being in the base frame; see `solve`."""
    base = rotations.conjugate(rotations.from_axis_angle(2, layout.base_pose[2]))
    origin = np.array([*layout.base_pose[:2], 0.0])
    return solve(
        chain,
        rotations.rotate(base, layout.eef_position - origin),
        rotations.matrix(rotations.multiply(base, layout.eef_quaternion)),
        starts,
    )


def pose(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Position (3,) and rotation matrix (3, 3) of the end effector at the joint angles `q` (n,)."""
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, len(q)))
    forward(chain, q, position, rotation, jacobian)
    return position, rotation
