"""Kinematics of a serial arm with hinge joints: poses, Jacobians, and the joint angles of a pose.

Simulator-free and compiled (`causalbench.core.numerics.compiled`). All poses are in the frame the chain starts in: for
a robot its base frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import kernels, linear, rotations
from causalbench.core.numerics.compiled import compiled
from causalbench.core.world.layout import Layout
from causalbench.errors import UnreachableLayoutError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

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
        kernels.axis_rotation(chain.axes[i], q[i], turn)
        kernels.matmul(rotation, turn, work)
        for r in range(3):
            offset = chain.offsets[i + 1]
            position[r] += work[r, 0] * offset[0] + work[r, 1] * offset[1] + work[r, 2] * offset[2]
        kernels.matmul(work, chain.rotations[i + 1], rotation)
    for i in range(n):
        x, y, z = position[0] - at[i, 0], position[1] - at[i, 1], position[2] - at[i, 2]
        jacobian[0, i] = axes[i, 1] * z - axes[i, 2] * y
        jacobian[1, i] = axes[i, 2] * x - axes[i, 0] * z
        jacobian[2, i] = axes[i, 0] * y - axes[i, 1] * x
        jacobian[3:, i] = axes[i]


@compiled
def _least_squares(jacobian: Array, free: Mask, twist: Array, damping: float, dq: Array) -> None:
    """`dq` (n,) = J^T (J J^T + damping)^-1 twist over the free columns, 0 elsewhere."""
    a, x, n = np.empty((6, 6)), twist.copy(), dq.shape[0]
    for i in range(6):
        for j in range(i + 1):
            a[i, j] = damping if i == j else 0.0
            for k in range(n):
                if free[k]:
                    a[i, j] += jacobian[i, k] * jacobian[j, k]
    linear.cholesky(a, 6)
    linear.cholesky_solve(a, 6, x)
    for k in range(n):
        s = 0.0
        if free[k]:
            for i in range(6):
                s += jacobian[i, k] * x[i]
        dq[k] = s


@compiled
def limited_least_squares(
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
def _solve(chain: Chain, goal_position: Array, goal_rotation: Array, q: Array) -> float:
    """Move `q` (n,) in place to the goal pose; the norm of the remaining pose error."""
    n = q.shape[0]
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, n))
    twist, dq, free = np.empty(6), np.empty(n), np.empty(n, np.bool_)
    error = np.inf
    for _ in range(SOLVE_ITERATIONS):
        forward(chain, q, position, rotation, jacobian)
        twist[:3] = goal_position - position
        kernels.rotation_vector(goal_rotation, rotation, twist[3:])
        error = np.sqrt((twist * twist).sum())
        if error < 0.1 * SOLVE_ERROR:
            break
        twist *= min(1.0, SOLVE_STRIDE / error)
        limited_least_squares(jacobian, q, chain.limits, twist, SOLVE_DAMPING, free, dq)
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
