"""One control step, compiled: robosuite's OSC_POSE law, the gripper and physics in a single call.

It reaches libmujoco by symbol name: names, not function pointers, let numba keep the machine code on disk between
processes.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from causalbench.core import arm_ik
from causalbench.core.compiled import compiled, external
from causalbench_robosuite.structs import Base, Law, Reference, Robot, State

Array = NDArray[np.float64]

N_JOINTS = 7
NULL_KP, NULL_KD = 10.0, 2 * np.sqrt(10.0)  # robosuite's pull of the null space towards the posture, 1/s2 and 1/s


def _library() -> str:
    """Path of the library that the mujoco package has loaded."""
    folder = Path(mujoco.__file__).parent
    found = [path for pattern in ("libmujoco.*", "mujoco.dll") for path in sorted(folder.glob(pattern))]
    if not found:
        raise ImportError(f"no MuJoCo library in {folder}")
    return str(found[0])


_LIBRARY = _library()
# mjModel*, mjData* and arrays travel as addresses.
_mj_step1 = external(_LIBRARY, "mj_step1", "address", "address")
_mj_step2 = external(_LIBRARY, "mj_step2", "address", "address")
_mj_jac_site = external(_LIBRARY, "mj_jacSite", "address", "address", "address", "address", "int32")


@compiled(error_model="numpy", inline="always")
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


@compiled
def _place(chain: arm_ik.Chain, base: Base, reference: Reference, jacobian: Array) -> None:
    """The reference's pose from its joints; `jacobian` (6, 7) is filled on the way."""
    position, rotation = np.empty(3), np.empty((3, 3))
    arm_ik.forward(chain, reference.joints, position, rotation, jacobian)
    arm_ik.matmul(base.rotation, rotation, reference.rotation)
    reference.position[:] = base.position + base.rotation @ position


@compiled
def _bound(error: Array, lead: float, delta: Array) -> None:
    """Change `delta` (3,) so that the reference, ahead by `error` (3,), ends up ahead by `lead` at most, in place."""
    ahead = error + delta
    size = np.sqrt((ahead * ahead).sum())
    if size > lead:
        delta[:] = ahead * (lead / size) - error


@compiled
def _advance(
    chain: arm_ik.Chain, base: Base, reference: Reference, state: State, law: Law, delta: Array, dt: float, speed: Array
) -> None:
    """Plan the reference's way of the next `dt` seconds, `speed` (13,), and put its pose and joints at the start of it.

    `delta` (6,): metres along the base axes and radians about the hand's own axes; `speed`: m/s and rad/s along the
    world's axes, then rad/s of the joints. The reference never runs further ahead of the hand than its lead.
    """
    jacobian, error, hand = np.empty((6, 7)), np.empty(3), state.matrix.reshape(3, 3)
    _place(chain, base, reference, jacobian)
    speed[:] = 0.0
    if not delta.any():
        return
    delta = delta.copy()
    _bound(base.rotation.T @ (reference.position - state.position), law.lead, delta[:3])
    arm_ik.rotation_error(reference.rotation, hand, error)
    _bound(reference.rotation.T @ error, law.turn_lead, delta[3:])
    position, rotation = reference.position.copy(), reference.rotation.copy()
    joints = reference.joints.copy()
    arm_ik.follow(chain, reference.joints, joints, delta, dt)
    _place(chain, base, reference, jacobian)
    arm_ik.rotation_error(reference.rotation, rotation, error)
    speed[:3], speed[3:6], speed[6:] = reference.position - position, error, reference.joints - joints
    speed /= dt
    reference.position[:], reference.rotation[:], reference.joints[:] = position, rotation, joints


@compiled
def _glide(reference: Reference, speed: Array, dt: float, turn: Array, old: Array) -> None:
    """Let the reference move with `speed` (13,) for `dt` seconds; `turn` and `old` (3, 3) are work space."""
    reference.position[:] += speed[:3] * dt
    reference.joints[:] += speed[6:] * dt
    rate = np.sqrt(speed[3] * speed[3] + speed[4] * speed[4] + speed[5] * speed[5])
    if rate > 0.0:
        arm_ik.axis_rotation(speed[3:6] / rate, rate * dt, turn)
        old[:] = reference.rotation
        arm_ik.matmul(turn, old, reference.rotation)


@compiled
def _grip(reference: Reference, robot: Robot, state: State, law: Law, closing: float, dt: float) -> None:
    """Bring the fingers together by `closing` m/s; the command leads the target by what damping and friction take.

    Both fingers have one target, so that the grip stays centred; neither target nor command ever leads the fingers by
    more than `law.grip_lead`: the grip is firm and winds nothing up. When `closing` becomes 0, free fingers stop at
    their target, and those that something holds back keep the command and thus their force.
    """
    (first, second), (low, high), command = robot.fingers, robot.finger_range, state.ctrl[robot.servos[0]]
    if closing != 0.0:
        finger, speed = (state.qpos[first] - state.qpos[second]) / 2, -closing / 2
        low, high = max(low, finger - law.grip_lead), min(high, finger + law.grip_lead)
        reference.finger[0] = min(max(reference.finger[0] + speed * dt, low), high)
        ahead = (robot.finger_damping * speed + robot.finger_friction * np.sign(speed)) / robot.finger_kp
        command = min(max(reference.finger[0] + ahead, low), high)
    elif command != reference.finger[0]:
        force = abs(command - reference.finger[0]) * robot.finger_kp - robot.finger_friction
        speed = abs(state.qvel[robot.finger_dofs[0]] - state.qvel[robot.finger_dofs[1]]) / 2
        if speed < 0.5 * force / robot.finger_damping:  # half of what free fingers would do
            reference.finger[0] = command
        command = reference.finger[0]
    state.ctrl[robot.servos[0]], state.ctrl[robot.servos[1]] = command, -command


@compiled(error_model="numpy")
def _arm(reference: Reference, robot: Robot, state: State, law: Law, speed: Array, work: Array) -> None:
    """The motors' torques: robosuite's operational space control with fixed gains.

    Torque = J^T F + bias + null space; F = Lambda (kp error - kd (velocity - the reference's velocity)), and likewise
    in the null space. That velocity, `speed` (13,), is ours; for a reference at rest the law is robosuite's.
    """
    n, nv = N_JOINTS, len(state.qvel)
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
    hand, goal = state.matrix, reference.rotation
    for r in range(3):
        error, linear, angular = 0.0, -speed[r], -speed[3 + r]
        i, k = (r + 1) % 3, (r + 2) % 3
        for c in range(3):  # half the sum of the cross products of the axes
            error += 0.5 * (hand[3 * i + c] * goal[k, c] - hand[3 * k + c] * goal[i, c])
        for v in range(nv):
            linear += state.jacobian[0, r, v] * state.qvel[v]
            angular += state.jacobian[1, r, v] * state.qvel[v]
        force[r] = law.kp[r] * (reference.position[r] - state.position[r]) - law.kd[r] * linear
        force[3 + r] = law.kp[3 + r] * error - law.kd[3 + r] * angular
    factor[:n, :n] = m[:n, :n]
    _solve(factor, n, jt, 6, mjt)
    for r in range(6):
        for c in range(6):
            s = 0.0
            for a in range(n):
                s += jt[a, r] * mjt[a, c]
            inverse[r, c] = s  # of Lambda
    if law.uncoupled:  # each half has its own Lambda
        for half in (0, 3):
            small[:3, :3] = inverse[half : half + 3, half : half + 3]
            _solve(small, 3, force[half : half + 3].reshape(3, 1), 1, wrench[half : half + 3].reshape(3, 1))
    else:
        small[:6, :6] = inverse[:6, :6]
        _solve(small, 6, force[:6].reshape(6, 1), 1, wrench[:6].reshape(6, 1))
    for a in range(n):
        q, v = state.qpos[robot.joints[a]], state.qvel[robot.dofs[a]]
        p[a] = NULL_KP * (reference.joints[a] - q) - NULL_KD * (v - speed[6 + a])
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


@compiled(nogil=True)
def track(
    model: int,
    data: int,
    substeps: int,
    dt: float,
    robot: Robot,
    law: Law,
    reference: Reference,
    speed: Array,
    closing: float,
    state: State,
) -> None:
    """Advance by `substeps` timesteps of `dt` seconds while the reference moves with `speed` (13,), see `_advance`.

    `model` and `data` are addresses; `closing` is in m/s. Enters after `mj_step1`; leaves as `mj_step` does.
    """
    work = np.empty((7, 8, 8))
    linear = state.jacobian.ctypes.data
    angular = linear + state.jacobian[0].nbytes
    for substep in range(substeps):
        if substep:
            _mj_step1(model, data)
        _glide(reference, speed, dt, work[0, :3, :3], work[1, :3, :3])
        _mj_jac_site(model, data, linear, angular, robot.site)
        _arm(reference, robot, state, law, speed, work)
        _grip(reference, robot, state, law, closing, dt)
        _mj_step2(model, data)


def _compile(stamp: int) -> Callable[..., int]:
    """The kernel. Numba's disk cache knows the code of this file and the values of the closure, not `arm_ik`.

    So the closure holds a stamp of that file: another version of it is compiled anew.
    """

    @compiled(nogil=True)
    def control_step(
        model: int,
        data: int,
        parts: int,
        substeps: int,
        delta: Array,
        dt: float,
        chain: arm_ik.Chain,
        base: Base,
        robot: Robot,
        law: Law,
        reference: Reference,
        state: State,
    ) -> int:
        """Advance by `parts` times `substeps` timesteps of `dt` seconds; in each part the reference moves by `delta`.

        `model` and `data` are addresses. `delta` (7,): metres along the base axes, radians about the hand's axes,
        metres of closing. Enters after `mj_step1`; leaves as `mj_step` does, with the contact forces of the last
        substep.
        """
        speed = np.empty(13)
        for part in range(parts):
            if part:
                _mj_step1(model, data)
            _advance(chain, base, reference, state, law, delta[:6], substeps * dt, speed)
            track(model, data, substeps, dt, robot, law, reference, speed, delta[6] / (substeps * dt), state)
        return stamp

    return control_step


control_step = _compile(zlib.crc32(Path(arm_ik.__file__).read_bytes()))
