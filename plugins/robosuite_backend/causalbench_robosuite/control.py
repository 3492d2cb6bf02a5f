"""One control step, compiled: robosuite's OSC_POSE law, the gripper and physics in a single call.

It reaches libmujoco by symbol name: names, not function pointers, let numba keep the machine code on disk between
processes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import mujoco
import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NULL_KP, NULL_KD = 10.0, 2 * np.sqrt(10.0)  # robosuite's pull of the null space towards the posture, 1/s2 and 1/s


class Robot(NamedTuple):
    """Where the robot is in MuJoCo's arrays, and its constants."""

    joints: Indices  # (7,) in qpos
    dofs: Indices  # (7,) in qvel
    motors: Indices  # (7,) in ctrl
    fingers: Indices  # (2,) in qpos
    servos: Indices  # (2,) in ctrl
    site: int  # the end effector
    inertia_address: Indices  # (nv,) of each row in the sparse inertia
    parent: Indices  # (nv,) of each dof
    ctrl_range: Array  # (nu, 2)
    finger_damping: float  # N s/m of a finger's joint
    finger_friction: float  # N
    finger_kp: float  # N/m of a finger's servo
    finger_range: Array  # (2,) m of the fingers' target


class State(NamedTuple):
    """Views of MuJoCo's arrays, which stay valid while its data live; `jacobian` is ours."""

    qpos: Array
    qvel: Array
    ctrl: Array
    bias: Array  # (nv,)
    inertia: Array  # (nM,) sparse
    position: Array  # (3,) m, end effector, world frame
    matrix: Array  # (9,)
    jacobian: Array  # (2, 3, nv) linear and angular


class Law(NamedTuple):
    """Gains (see `model.Gains`) and how far the references may run ahead of what is measured."""

    kp: Array
    kd: Array
    lead: float  # m
    turn_lead: float  # rad
    grip_lead: float  # m of a finger


class Goal(NamedTuple):
    """The controller's memory."""

    position: Array  # (3,) m, reference of the end effector, world frame
    rotation: Array  # (3, 3)
    posture: Array  # (7,) rad, for the null space
    finger: Array  # (1,) m, target of each finger


def _library() -> str:
    """Path of the library that the mujoco package has loaded."""
    folder = Path(mujoco.__file__).parent
    found = [path for pattern in ("libmujoco.*", "mujoco.dll") for path in sorted(folder.glob(pattern))]
    if not found:
        raise ImportError(f"no MuJoCo library in {folder}")
    return str(found[0])


llvm.load_library_permanently(_library())
_ADDRESS = nb.types.intp  # mjModel*, mjData* and the Jacobian's rows travel as addresses
_mj_step1: Any = nb.types.ExternalFunction("mj_step1", nb.types.void(_ADDRESS, _ADDRESS))
_mj_step2: Any = nb.types.ExternalFunction("mj_step2", nb.types.void(_ADDRESS, _ADDRESS))
_mj_jac_site: Any = nb.types.ExternalFunction(
    "mj_jacSite", nb.types.void(_ADDRESS, _ADDRESS, _ADDRESS, _ADDRESS, nb.types.int32)
)


@nb.njit(cache=True)
def _solve(a: Array, n: int, b: Array, k: int, x: Array) -> None:
    """`x` (n, k) = `a`^-1 `b` for a symmetric positive definite `a` (n, n), which its Cholesky factor replaces."""
    for j in range(n):
        for i in range(j, n):
            s = a[i, j]
            for p in range(j):
                s -= a[i, p] * a[j, p]
            a[i, j] = np.sqrt(max(s, 1e-14)) if i == j else s / a[j, j]
    for c in range(k):
        for i in range(n):
            s = b[i, c]
            for p in range(i):
                s -= a[i, p] * x[p, c]
            x[i, c] = s / a[i, i]
        for i in range(n - 1, -1, -1):
            s = x[i, c]
            for p in range(i + 1, n):
                s -= a[p, i] * x[p, c]
            x[i, c] = s / a[i, i]


@nb.njit(cache=True)
def _turn(x: float, y: float, z: float, out: Array) -> None:
    """`out` (3, 3) = the rotation by the rotation vector (x, y, z) rad (Rodrigues)."""
    angle = np.sqrt(x * x + y * y + z * z)
    scale = 1.0 / max(angle, 1e-12)
    x, y, z = x * scale, y * scale, z * scale
    c, s = np.cos(angle), np.sin(angle)
    k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@nb.njit(cache=True)
def _product(a: Array, b: Array, out: Array) -> None:
    """`out` = a b for 3 x 3 matrices; `out` may be neither of them."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@nb.njit(cache=True)
def _advance(goal: Goal, state: State, law: Law, twist: Array, dt: float, work: Array) -> None:
    """Move the hand's reference by `twist` (6,) for `dt` seconds, and keep it within its lead of the hand.

    `twist`: m/s along the world's axes and rad/s about the reference's own axes.
    """
    turn, old = work[0, :3, :3], work[1, :3, :3]
    if twist[3] != 0.0 or twist[4] != 0.0 or twist[5] != 0.0:
        _turn(twist[3] * dt, twist[4] * dt, twist[5] * dt, turn)
        old[:] = goal.rotation
        _product(old, turn, goal.rotation)
    square = 0.0
    for i in range(3):
        goal.position[i] += twist[i] * dt
        square += (goal.position[i] - state.position[i]) ** 2
    if square > law.lead * law.lead:
        share = law.lead / np.sqrt(square)
        for i in range(3):
            goal.position[i] = state.position[i] + (goal.position[i] - state.position[i]) * share
    # The rotation from the hand to the reference in the hand's frame.
    hand = state.matrix.reshape(3, 3)
    _product(hand.T, goal.rotation, turn)
    cosine = (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1.0) / 2
    x, y, z = (turn[2, 1] - turn[1, 2]) / 2, (turn[0, 2] - turn[2, 0]) / 2, (turn[1, 0] - turn[0, 1]) / 2
    sine = np.sqrt(x * x + y * y + z * z)
    if np.arctan2(sine, cosine) > law.turn_lead:
        scale = law.turn_lead / max(sine, 1e-12)
        _turn(x * scale, y * scale, z * scale, turn)
        _product(hand, turn, goal.rotation)


@nb.njit(cache=True)
def _grip(goal: Goal, robot: Robot, state: State, law: Law, closing: float, dt: float) -> None:
    """Bring the fingers together by `closing` m/s; the servos' targets lead by what joint damping and friction take.

    Both fingers have one target, so that the grip stays centred; neither target nor command ever leads the fingers by
    more than `law.grip_lead`: the grip is firm and winds nothing up. With `closing` 0 the command stays.
    """
    low, high = robot.finger_range
    ahead = 0.0
    if closing != 0.0:
        finger = (state.qpos[robot.fingers[0]] - state.qpos[robot.fingers[1]]) / 2
        speed = -closing / 2
        ahead = (robot.finger_damping * speed + robot.finger_friction * np.sign(speed)) / robot.finger_kp
        low, high = max(low, finger - law.grip_lead), min(high, finger + law.grip_lead)
        goal.finger[0] = min(max(goal.finger[0] + speed * dt, low), high)
    command = min(max(goal.finger[0] + ahead, low), high)
    state.ctrl[robot.servos[0]], state.ctrl[robot.servos[1]] = command, -command


@nb.njit(cache=True)
def _arm(goal: Goal, robot: Robot, state: State, law: Law, twist: Array, work: Array) -> None:
    """The motors' torques: robosuite's operational space control with fixed gains, position and rotation uncoupled.

    Torque = J^T F + bias + null space; F = Lambda (kp error - kd (velocity - the reference's velocity)). The last
    term is ours; for a reference at rest the law is robosuite's. `twist` as in `_advance`.
    """
    n, nv = len(robot.dofs), len(state.qvel)
    m, factor, jt, mjt, small, inverse = work[0], work[1], work[2], work[3], work[4], work[5]
    force, wrench, pull, p = work[6, 0], work[6, 1], work[6, 2], work[6, 3]
    for a in range(n):  # the arm's block of the sparse joint inertia
        address, j = robot.inertia_address[robot.dofs[a]], robot.dofs[a]
        while j >= 0:
            for b in range(a + 1):
                if robot.dofs[b] == j:
                    m[a, b] = m[b, a] = state.inertia[address]
            address += 1
            j = robot.parent[j]
        for r in range(3):
            jt[a, r] = state.jacobian[0, r, robot.dofs[a]]
            jt[a, 3 + r] = state.jacobian[1, r, robot.dofs[a]]
    hand, reference = state.matrix, goal.rotation
    for r in range(3):
        error, spin = 0.0, 0.0
        i, k = (r + 1) % 3, (r + 2) % 3
        for c in range(3):  # half the sum of the cross products of the axes
            error += 0.5 * (hand[3 * i + c] * reference[k, c] - hand[3 * k + c] * reference[i, c])
            spin += reference[r, c] * twist[3 + c]
        linear, angular = -twist[r], -spin
        for v in range(nv):
            linear += state.jacobian[0, r, v] * state.qvel[v]
            angular += state.jacobian[1, r, v] * state.qvel[v]
        force[r] = law.kp[r] * (goal.position[r] - state.position[r]) - law.kd[r] * linear
        force[3 + r] = law.kp[3 + r] * error - law.kd[3 + r] * angular
    factor[:n, :n] = m[:n, :n]
    _solve(factor, n, jt, 6, mjt)
    for r in range(6):
        for c in range(6):
            s = 0.0
            for a in range(n):
                s += jt[a, r] * mjt[a, c]
            inverse[r, c] = s  # of Lambda
    for half in (0, 3):  # uncoupled: each half has its own Lambda
        small[:3, :3] = inverse[half : half + 3, half : half + 3]
        _solve(small, 3, force[half : half + 3].reshape(3, 1), 1, wrench[half : half + 3].reshape(3, 1))
    for a in range(n):
        q, v = state.qpos[robot.joints[a]], state.qvel[robot.dofs[a]]
        p[a] = NULL_KP * (goal.posture[a] - q) - NULL_KD * v
    for r in range(6):
        force[r] = 0.0
        for a in range(n):
            force[r] += jt[a, r] * p[a]
    small[:6, :6] = inverse[:6, :6]
    _solve(small, 6, force[:6].reshape(6, 1), 1, pull[:6].reshape(6, 1))
    for a in range(n):
        torque = state.bias[robot.dofs[a]]
        for b in range(n):
            torque += m[a, b] * p[b]
        for r in range(6):
            torque += jt[a, r] * (wrench[r] - pull[r])
        motor = robot.motors[a]
        state.ctrl[motor] = min(max(torque, robot.ctrl_range[motor, 0]), robot.ctrl_range[motor, 1])


@nb.njit(cache=True, nogil=True)
def control_step(
    model: int,
    data: int,
    substeps: int,
    twist: Array,
    dt: float,
    robot: Robot,
    law: Law,
    goal: Goal,
    state: State,
) -> None:
    """Advance by `substeps` timesteps of `dt` seconds; `goal` moves on in each.

    `model` and `data` are addresses. `twist` (7,): m/s along the world's axes, rad/s about the hand's axes, m/s of
    closing. Enters after `mj_step1`; leaves as `mj_step` does, with the contact forces of the last substep.
    """
    work = np.empty((7, 8, 8))
    linear = state.jacobian.ctypes.data
    angular = linear + state.jacobian[0].nbytes
    for substep in range(substeps):
        if substep:
            _mj_step1(model, data)
        _advance(goal, state, law, twist, dt, work)
        _mj_jac_site(model, data, linear, angular, robot.site)
        _arm(goal, robot, state, law, twist, work)
        _grip(goal, robot, state, law, twist[6], dt)
        _mj_step2(model, data)
