"""Robot bases: fixed to the world, or on joints x, y and yaw with a servo each."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import rotations
from causalbench_mujoco.engine import mujoco

Array = NDArray[np.float64]


class Base(ABC):
    """Where a robot stands. Poses are (3,): x m, y m and yaw rad in the world."""

    @abstractmethod
    def place(self, pose: Array) -> None:
        """Put the base at `pose`, at rest."""

    @abstractmethod
    def pose(self) -> Array:
        """Where the base is; the caller's own."""

    def velocity(self) -> Array:
        """Forward m/s and turn rad/s (2,), see `Facts`."""
        return np.zeros(2)


class FixedBase(Base):
    """A base without joints: the body `name`, a child of the world."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        self._model, self._body = model, int(model.body(name).id)
        self._pose = np.zeros(3)

    def place(self, pose: Array) -> None:
        self._pose = pose.copy()
        self._model.body_pos[self._body, :2] = pose[:2]
        self._model.body_quat[self._body] = rotations.from_axis_angle(2, pose[2])

    def pose(self) -> Array:
        return self._pose.copy()


class JointBase(Base):
    """A base on `joints` x, y and yaw at the world's origin, each with one of `servos`.

    Servos hold positions where the base only stands, and velocities where it drives. `joints` are where they are in
    qpos, `servos` in ctrl.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: Sequence[str],
        servos: Sequence[str],
        drives: bool,
    ) -> None:
        self._data, self._drives = data, drives
        self.joints = np.array([int(model.joint(name).qposadr[0]) for name in joints])
        self.servos = np.array([int(model.actuator(name).id) for name in servos])
        self._dofs = np.array([int(model.joint(name).dofadr[0]) for name in joints])

    def place(self, pose: Array) -> None:
        self._data.qpos[self.joints] = pose
        self._data.ctrl[self.servos] = 0.0 if self._drives else pose

    def drive(self, velocities: Array) -> None:
        """Velocities (3,) of x, y and yaw, m/s and rad/s in the world, for the servos to hold until the next call."""
        self._data.ctrl[self.servos] = velocities

    def pose(self) -> Array:
        pose: Array = self._data.qpos[self.joints]
        return pose

    def velocity(self) -> Array:
        yaw, speed = float(self._data.qpos[self.joints[2]]), self._data.qvel[self._dofs]
        return np.array([math.cos(yaw) * speed[0] + math.sin(yaw) * speed[1], speed[2]])


def hold_velocity(servo: mujoco.MjsActuator, gain: float, force: float | None = None) -> None:
    """Make an actuator hold the velocity that it is given, with `gain` N s/m or N m s/rad and `force` N or N m."""
    servo.gainprm[0] = gain
    servo.biasprm[:3] = 0.0, 0.0, -gain
    if force is not None:
        servo.forcelimited, servo.forcerange = True, [-force, force]
