"""One control step, compiled: robosuite's OSC_POSE law, the gripper and physics in a single call."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import arm_ik, compiled, joint_following, kernels, linear
from causalbench_mujoco.library import mj_jac_site, mj_step1, mj_step2
from causalbench_robosuite import riding
from causalbench_robosuite.structs import N_JOINTS, Base, Law, Reference, Robot, State, Work

Array = NDArray[np.float64]

NULL_KP, NULL_KD = 10.0, 2 * np.sqrt(10.0)  # robosuite's pull of the null space towards the posture, 1/s2 and 1/s

# A call that hands over tuples of dozens of arrays costs more than what most functions here compute.
_inlined = compiled(error_model="numpy", forceinline=True)


@_inlined
def _place(chain: arm_ik.Chain, base: Base, reference: Reference, jacobian: Array) -> None:
    """The reference's pose from its joints; `jacobian` (6, 7) is filled on the way."""
    position, rotation = np.empty(3), np.empty((3, 3))
    arm_ik.forward(chain, reference.joints, position, rotation, jacobian)
    kernels.matmul(base.rotation, rotation, reference.rotation)
    for r in range(3):
        reference.position[r] = base.position[r]
        for c in range(3):
            reference.position[r] += base.rotation[r, c] * position[c]


@_inlined
def _bound(frame: Array, error: Array, lead: float, delta: Array) -> None:
    """Change `delta` (3,), in place, so that a reference that is ahead by `error` (3,) ends up ahead by `lead` at most.

    `error` is in the world, `delta` in the axes of `frame` (3, 3).
    """
    size = 0.0
    own = np.empty(3)
    for r in range(3):
        own[r] = frame[0, r] * error[0] + frame[1, r] * error[1] + frame[2, r] * error[2]
        size += (own[r] + delta[r]) ** 2
    size = np.sqrt(size)
    if size > lead:
        for r in range(3):
            delta[r] = (own[r] + delta[r]) * (lead / size) - own[r]


@_inlined
def _advance(
    chain: arm_ik.Chain, base: Base, reference: Reference, state: State, law: Law, delta: Array, dt: float, speed: Array
) -> None:
    """Plan the reference's way of the next `dt` seconds, `speed` (13,), and put its pose and joints at the start of it.

    `delta` (6,): metres along the base axes and radians about the hand's own axes; `speed`: m/s and rad/s along the
    world's axes, then rad/s of the joints. The reference never runs further ahead of the hand than its lead.
    """
    jacobian, error, bounded, hand = np.empty((6, 7)), np.empty(3), np.empty(6), state.matrix.reshape(3, 3)
    _place(chain, base, reference, jacobian)
    speed[:] = 0.0
    moving = False
    for i in range(6):
        bounded[i] = delta[i]
        moving = moving or delta[i] != 0.0
    if not moving:
        return
    for i in range(3):
        error[i] = reference.position[i] - state.position[i]
    _bound(base.rotation, error, law.lead, bounded[:3])
    kernels.rotation_vector(reference.rotation, hand, error)
    _bound(reference.rotation, error, law.turn_lead, bounded[3:])
    position, rotation, joints = reference.position.copy(), reference.rotation.copy(), reference.joints.copy()
    joint_following.follow(chain, reference.joints, joints, bounded, dt)
    _place(chain, base, reference, jacobian)
    kernels.rotation_vector(reference.rotation, rotation, error)
    for i in range(3):
        speed[i], speed[3 + i] = (reference.position[i] - position[i]) / dt, error[i] / dt
    for i in range(N_JOINTS):
        speed[6 + i] = (reference.joints[i] - joints[i]) / dt
    reference.position[:], reference.rotation[:], reference.joints[:] = position, rotation, joints


@_inlined
def _turn(speed: Array, dt: float, out: Array) -> bool:
    """`out` (3, 3) = how `speed` (13,) turns the reference in `dt` seconds; whether it does."""
    rate = np.sqrt(speed[3] * speed[3] + speed[4] * speed[4] + speed[5] * speed[5])
    if rate > 0.0:
        kernels.axis_rotation(speed[3:6] / rate, rate * dt, out)
    return rate > 0.0


@_inlined
def _glide(reference: Reference, speed: Array, dt: float, turning: bool, turn: Array, old: Array) -> None:
    """Let the reference move with `speed` (13,) for `dt` seconds; `turn` is that of `_turn`, `old` (3, 3) scratch."""
    for i in range(3):
        reference.position[i] += speed[i] * dt
    for i in range(N_JOINTS):
        reference.joints[i] += speed[6 + i] * dt
    if turning:
        for r in range(3):
            for c in range(3):
                old[r, c] = reference.rotation[r, c]
        kernels.matmul(turn, old, reference.rotation)


@_inlined
def _grip(reference: Reference, robot: Robot, state: State, law: Law, closing: float, dt: float) -> None:
    """Bring the fingers together by `closing` m/s; the command leads the target by what damping and friction take.

    Both fingers have one target, so that the grip stays centred; neither target nor command ever leads the fingers by
    more than `law.grip_lead`: the grip is firm and winds nothing up. When `closing` becomes 0, free fingers stop where
    they are, and those that something holds back keep the command and thus their force.
    """
    command = state.ctrl[robot.servos[0]]
    finger = (state.qpos[robot.fingers[0]] - state.qpos[robot.fingers[1]]) / 2
    if closing != 0.0:
        speed = -closing / 2
        low, high = (
            max(robot.finger_range[0], finger - law.grip_lead),
            min(robot.finger_range[1], finger + law.grip_lead),
        )
        reference.finger[0] = min(max(reference.finger[0] + speed * dt, low), high)
        ahead = (robot.finger_damping * speed + robot.finger_friction * np.sign(speed)) / robot.finger_kp
        command = min(max(reference.finger[0] + ahead, low), high)
    else:
        if command != reference.finger[0]:
            force = abs(command - reference.finger[0]) * robot.finger_kp - robot.finger_friction
            speed = abs(state.qvel[robot.finger_dofs[0]] - state.qvel[robot.finger_dofs[1]]) / 2
            held_back = speed < 0.5 * force / robot.finger_damping  # half of what free fingers would do
            command = reference.finger[0] = command if held_back else finger
        if abs(command - finger) * robot.finger_kp < robot.finger_friction:
            # Dry friction would stand this; MuJoCo's, which is regularised, creeps.
            command = reference.finger[0] = finger
    state.ctrl[robot.servos[0]], state.ctrl[robot.servos[1]] = command, -command


@_inlined
def _load(robot: Robot, state: State, work: Work) -> None:
    """Copy the arm's part of MuJoCo's sparse joint inertia and of the Jacobian to `work`."""
    for a in range(N_JOINTS):
        for b in range(N_JOINTS):
            work.inertia[a, b] = state.inertia[robot.inertia[a, b]]
        for r in range(3):
            work.jacobian[a, r] = state.jacobian[0, r, robot.dofs[a]]
            work.jacobian[a, 3 + r] = state.jacobian[1, r, robot.dofs[a]]


@_inlined
def _arm(reference: Reference, robot: Robot, state: State, law: Law, speed: Array, work: Work) -> None:
    """The motors' torques: robosuite's operational space control with fixed gains.

    Torque = J^T F + bias + null space; F = Lambda (kp error - kd (velocity - the reference's velocity)), and likewise
    in the null space. That velocity, `speed` (13,), is ours; for a reference at rest the law is robosuite's. With the
    inertia M = L D L^T, Lambda^-1 = J M^-1 J^T is Y^T D^-1 Y, where Y = L^-1 J^T.
    """
    m, c, jt, y, mobility = work.inertia, work.factor, work.jacobian, work.half, work.mobility
    force, wrench, p = work.force, work.wrench, work.pull
    _load(robot, state, work)
    hand, goal = state.matrix, reference.rotation
    for r in range(3):
        i, k = (r + 1) % 3, (r + 2) % 3
        error = 0.0
        for a in range(3):  # half the sum of the cross products of the axes
            error += 0.5 * (hand[3 * i + a] * goal[k, a] - hand[3 * k + a] * goal[i, a])
        force[r], force[3 + r] = reference.position[r] - state.position[r], error
    for r in range(6):
        wrench[r] = -speed[r]
    for a in range(N_JOINTS):
        v = state.qvel[robot.dofs[a]]
        for r in range(6):
            wrench[r] += jt[a, r] * v
    for r in range(6):
        force[r] = law.kp[r] * force[r] - law.kd[r] * wrench[r]
        wrench[r] = 0.0
        for k in range(6):
            mobility[r, k] = 0.0
    for a in range(N_JOINTS):
        for b in range(N_JOINTS):
            c[a, b] = m[a, b]
    linear.ldl(c, N_JOINTS)
    for a in range(N_JOINTS):
        for r in range(6):
            y[a, r] = jt[a, r]
        for b in range(a):
            for r in range(6):
                y[a, r] -= c[a, b] * y[b, r]
        for r in range(6):
            scaled = y[a, r] * c[a, a]
            for k in range(r + 1):
                mobility[r, k] += scaled * y[a, k]
    if law.uncoupled:  # each half has its own Lambda
        small = work.small
        for half in (0, 3):
            small[:] = mobility[half : half + 3, half : half + 3]
            wrench[half : half + 3] = force[half : half + 3]
            linear.ldl(small, 3)
            linear.ldl_solve(small, 3, wrench[half : half + 3])
            force[half : half + 3] = 0.0
    for a in range(N_JOINTS):
        q, v = state.qpos[robot.joints[a]], state.qvel[robot.dofs[a]]
        p[a] = NULL_KP * (reference.joints[a] - q) - NULL_KD * (v - speed[6 + a])
        for r in range(6):
            force[r] -= jt[a, r] * p[a]  # what the pull of the null space would do to the hand
    linear.ldl(mobility, 6)
    linear.ldl_solve(mobility, 6, force)
    for r in range(6):
        wrench[r] += force[r]
    for a in range(N_JOINTS):
        torque = state.bias[robot.dofs[a]]
        for b in range(N_JOINTS):
            torque += m[a, b] * p[b]
        for r in range(6):
            torque += jt[a, r] * wrench[r]
        motor = robot.motors[a]
        state.ctrl[motor] = min(max(torque, robot.ctrl_range[motor, 0]), robot.ctrl_range[motor, 1])


@compiled(nogil=True)
def track(
    model: int,
    data: int,
    substeps: int,
    dt: float,
    base: Base,
    robot: Robot,
    law: Law,
    reference: Reference,
    speed: Array,
    closing: float,
    state: State,
) -> None:
    """Advance by `substeps` timesteps of `dt` seconds while the reference moves with `speed` (13,), see `_advance`.

    The reference and its speed are relative to `base`, and so is the hand's velocity in the law.

    `model` and `data` are addresses; `closing` is in m/s. Enters after `mj_step1`; leaves as `mj_step` does.
    """
    n = N_JOINTS
    work = Work(
        np.empty((n, n)), np.empty((n, n)), np.empty((n, 6)), np.empty((n, 6)), np.empty((6, 6)), np.empty(6),
        np.empty(6), np.empty(n), np.empty((3, 3)), np.empty((3, 3)),
        np.empty((3, 3)),
    )  # fmt: skip
    linear = state.jacobian.ctypes.data
    angular = linear + state.jacobian[0].nbytes
    turning = _turn(speed, dt, work.turn)
    for substep in range(substeps):
        if substep:
            mj_step1(model, data)
            riding.ride(base, robot, state, reference, speed, work.small, work.ride)
        _glide(reference, speed, dt, turning, work.turn, work.small)
        mj_jac_site(model, data, linear, angular, robot.site)
        _arm(reference, robot, state, law, speed, work)
        _grip(reference, robot, state, law, closing, dt)
        mj_step2(model, data)


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
) -> None:
    """Advance by `parts` times `substeps` timesteps of `dt` seconds; in each part the reference moves by `delta`.

    `model` and `data` are addresses. `delta` (7,): metres along the base axes, radians about the hand's axes,
    metres of closing. Enters after `mj_step1`; leaves as `mj_step` does, with the contact forces of the last
    substep.
    """
    speed = np.empty(13)
    for part in range(parts):
        if part:
            mj_step1(model, data)
        riding.locate(base, robot, state)
        _advance(chain, base, reference, state, law, delta[:6], substeps * dt, speed)
        track(model, data, substeps, dt, base, robot, law, reference, speed, delta[6] / (substeps * dt), state)
