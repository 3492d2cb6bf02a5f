"""The hand's reference rides on a base that drives. Compiled; part of the control step of `control.py`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import compiled, kernels
from causalbench_robosuite.structs import Base, Reference, Robot, State

Array = NDArray[np.float64]


@compiled
def locate(base: Base, robot: Robot, state: State) -> None:
    """Put `base` where the joints of a base that drives are; one that stands stays where it is."""
    if robot.base.shape[0]:
        yaw = state.qpos[robot.base[2]]
        cos, sin = np.cos(yaw), np.sin(yaw)
        base.position[0], base.position[1] = state.qpos[robot.base[0]], state.qpos[robot.base[1]]
        base.rotation[0, 0], base.rotation[0, 1] = cos, -sin
        base.rotation[1, 0], base.rotation[1, 1] = sin, cos


@compiled
def ride(base: Base, robot: Robot, state: State, reference: Reference, speed: Array, old: Array, turn: Array) -> None:
    """Carry the reference's pose and `speed` (13,), which is relative to the base, along since `base` was located.

    `old` and `turn`, both (3, 3), are scratch.
    """
    if robot.base.shape[0]:
        x, y = base.position[0], base.position[1]
        c, s = base.rotation[0, 0], base.rotation[1, 0]
        locate(base, robot, state)
        cos = base.rotation[0, 0] * c + base.rotation[1, 0] * s
        sin = base.rotation[1, 0] * c - base.rotation[0, 0] * s
        ahead, left = reference.position[0] - x, reference.position[1] - y
        reference.position[0] = base.position[0] + cos * ahead - sin * left
        reference.position[1] = base.position[1] + sin * ahead + cos * left
        for first in (0, 3):
            ahead, left = speed[first], speed[first + 1]
            speed[first], speed[first + 1] = cos * ahead - sin * left, sin * ahead + cos * left
        turn[:] = 0.0
        turn[0, 0] = turn[1, 1] = cos
        turn[0, 1], turn[1, 0], turn[2, 2] = -sin, sin, 1.0
        for r in range(3):
            for k in range(3):
                old[r, k] = reference.rotation[r, k]
        kernels.matmul(turn, old, reference.rotation)
