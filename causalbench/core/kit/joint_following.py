"""How the joint targets of a serial arm follow the macro actions of its hand. Simulator-free and compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit.arm_ik import Chain, forward, limited_least_squares
from causalbench.core.numerics import kernels
from causalbench.core.numerics.compiled import compiled

Array = NDArray[np.float64]

DAMPING = 2e-4  # of the least squares, rotations weighted
ROTATION_WEIGHT = 0.3  # m: an error of one radian counts as much as one of 0.3 m
MAX_JOINT_SPEED = 1.5  # rad/s of a joint target: what servos with 0.04 s of lag follow within LEAD
LEAD = 0.10  # rad by which a joint target may lie off the measured joint: bounds force and wind-up
ITERATIONS = 2  # per control step; with one alone the hand drifts while it turns


@compiled
def _displace(
    position: Array, rotation: Array, delta: Array, share: float, goal_position: Array, goal_rotation: Array
) -> None:
    """The goal (3,), (3, 3) = the pose (3,), (3, 3) moved by `share` of `delta` (6,), see `follow`."""
    turn = np.empty((3, 3))
    angle = np.sqrt(delta[3] * delta[3] + delta[4] * delta[4] + delta[5] * delta[5])
    kernels.axis_rotation(delta[3:] / max(angle, 1e-12), angle * share, turn)
    kernels.matmul(rotation, turn, goal_rotation)
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
                kernels.rotation_vector(goal_rotation, rotation, twist[3:])
            twist[3:] *= ROTATION_WEIGHT
            jacobian[3:] *= ROTATION_WEIGHT
            limited_least_squares(jacobian, target, chain.limits, twist, DAMPING, free, dq)
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
