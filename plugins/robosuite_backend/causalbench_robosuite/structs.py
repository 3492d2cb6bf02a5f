"""What the compiled control step is given: plain tuples of numbers and arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

N_JOINTS = 7


class Robot(NamedTuple):
    """Where the robot is in MuJoCo's arrays, and its constants."""

    base: Indices  # x, y and yaw in qpos of a base that drives; empty for one that stands
    joints: Indices  # (7,) in qpos
    dofs: Indices  # (7,) in qvel
    motors: Indices  # (7,) in ctrl
    fingers: Indices  # (2,) in qpos
    finger_dofs: Indices  # (2,) in qvel
    servos: Indices  # (2,) in ctrl
    site: int  # the end effector
    inertia: Indices  # (7, 7) where in MuJoCo's sparse inertia the arm's is
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
    uncoupled: bool
    lead: float  # m
    turn_lead: float  # rad
    grip_lead: float  # m of a finger


class Reference(NamedTuple):
    """The controller's memory, `joints` and `finger`, and the pose that follows from it, world frame."""

    joints: Array  # (7,) rad: their pose is what the hand follows, they themselves are the null space's posture
    finger: Array  # (1,) m, target of each finger
    position: Array  # (3,) m
    rotation: Array  # (3, 3)


class Base(NamedTuple):
    """The robot base frame in the world; of a base that drives, where it was when the control step last looked."""

    position: Array  # (3,) m
    rotation: Array  # (3, 3)


class Work(NamedTuple):
    """Work space of the control step; made anew in every call of `control.track`."""

    inertia: Array  # (7, 7) of the arm's joints
    factor: Array  # (7, 7) its Cholesky factor
    jacobian: Array  # (7, 6) transposed
    half: Array  # (7, 6) the factor's inverse times the former
    mobility: Array  # (6, 6)
    force: Array  # (6,)
    wrench: Array  # (6,)
    pull: Array  # (7,)
    small: Array  # (3, 3)
    turn: Array  # (3, 3)
    ride: Array  # (3, 3)
