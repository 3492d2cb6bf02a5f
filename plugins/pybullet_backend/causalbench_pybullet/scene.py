"""`PybulletScene`: Fetch in Bullet behind the `Scene` contract. Bullet is in `world.py`, the robot in `robot.py`."""

from __future__ import annotations

import dataclasses
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import (
    ACTION_SPEED,
    ARM_ACTIONS,
    CausalbenchError,
    Facts,
    Layout,
    Scene,
    SceneSpec,
    SnapshotCodec,
    UserError,
    arm_ik,
    check_action,
    check_layout,
    fetch,
    find_camera,
    joint_following,
    stepping,
)
from causalbench_pybullet import CAPABILITIES, __version__, robot
from causalbench_pybullet.reading import read_contacts, read_others, read_poses
from causalbench_pybullet.world import World, shapes_of

Array = NDArray[np.float64]

GRIP_LEAD = 0.005  # m by which a finger's target may run ahead of the finger: enough for full force and speed
N_ARM = len(fetch.JOINTS)


class PybulletScene(Scene):
    """Fetch and free boxes among fixtures. The base stands still; arm and fingers follow motor targets."""

    world_type: type[World] = World

    def __init__(self, control_hz: float, timestep: float, solver_iterations: int) -> None:
        self.substeps = stepping.whole_substeps(control_hz, timestep)
        if solver_iterations < 1:
            raise UserError(f"solver_iterations must be at least 1, not {solver_iterations}")
        self._robot = robot.load()
        self.spec = SceneSpec(
            backend="pybullet",
            backend_version=__version__,
            engine="Bullet",
            engine_version=metadata.version("pybullet"),
            robot="Fetch",
            actions=ARM_ACTIONS,
            action_speed=tuple(ACTION_SPEED[name] for name in ARM_ACTIONS),
            workspace=fetch.WORKSPACE,
            max_opening=self._robot.gap + 2 * fetch.FINGER_STROKE,
            control_dt=self.substeps * timestep,
            timestep=timestep,
            capabilities=CAPABILITIES,
            engine_settings={"solver_iterations": solver_iterations},
        )
        self._iterations = solver_iterations
        self._codec = SnapshotCodec(self.spec)
        self._parts = stepping.target_parts(self.substeps, timestep)
        self._part = self.substeps // self._parts  # substeps
        self._stride = np.array(self.spec.action_speed) * self._part * timestep
        self._target = np.zeros(N_ARM)  # rad, of the arm's motors
        self._finger = 0.0  # m, of both fingers' motors
        self._reference = np.zeros(0)  # where a base that drives shall be
        self._flags = np.zeros(4, dtype=np.bool_)  # base, arm and self-collision, holding
        self._base = np.zeros(3)
        self._world: World | None = None
        self._closed = False

    @property
    def world(self) -> World:
        """The simulator's world, for measurements; a layout with boxes of other sizes replaces it."""
        if self._world is None:
            raise CausalbenchError("the scene is closed" if self._closed else "call reset() first")
        return self._world

    def reset(self, layout: Layout) -> None:
        """Put the world into `layout`, at rest.

        Raises `UnreachableLayoutError` when the arm cannot take the pose, or when the start is not at rest because
        things overlap.
        """
        check_layout(layout, self.spec)
        joints = arm_ik.reach(self._robot.chain, layout, fetch.ARM_STARTS)
        world = self._enter(layout)
        finger = min(max((layout.gripper_opening - self._robot.gap) / 2, 0.0), fetch.FINGER_STROKE)
        self._target[:], self._finger = joints, finger
        world.set_joints(np.append(joints, [finger, finger]))
        world.aim(self.motor_targets())
        world.advance(max(1, round(stepping.SETTLE / self.spec.timestep)))
        self._read_flags()
        stepping.check_settled(self.facts(), layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` (7,) in [-1, 1]. Raises `InvalidActionError`."""
        delta = check_action(action, (len(ARM_ACTIONS),)) * self._stride
        world, chain, dt = self.world, self._robot.chain, self._part * self.spec.timestep
        turn, closing = delta[:6], float(delta[6])
        for _ in range(self._parts):
            positions = world.joint_positions()
            joint_following.follow(chain, self._target, positions[:N_ARM], turn, dt)
            if closing:
                # Both alike, and never far ahead of the fingers: opening starts at once.
                finger = float(positions[N_ARM] + positions[N_ARM + 1]) / 2
                target = min(max(self._finger - closing / 2, finger - GRIP_LEAD), finger + GRIP_LEAD)
                self._finger = min(max(target, 0.0), fetch.FINGER_STROKE)
            world.aim(self.motor_targets())
            world.advance(self._part)
        self._read_flags()

    def facts(self) -> Facts:
        """What holds now. Contacts are those that the last substep was solved with, all else is the state after it."""
        x, flags, base = read_poses(self.world, self._robot), self._flags, self._read_base()
        facts = Facts(
            eef_position=x[0:3],
            eef_quaternion=x[3:7],
            gripper_opening=x[14],
            holding=flags[3],
            object_position=x[7:10],
            object_quaternion=x[10:14],
            base_pose=base[:3],
            base_velocity=base[3:],
            collision_base=flags[0],
            collision_arm=flags[1],
            collision_self=flags[2],
        )
        if not self.world.others:
            return facts
        positions, quaternions = read_others(self.world)
        return dataclasses.replace(facts, other_positions=positions, other_quaternions=quaternions)

    def _read_base(self) -> Array:
        """Pose and velocity (5,) of the base, which stands where it was put."""
        return np.append(self._base, [0.0, 0.0])

    def _read_flags(self) -> None:
        """Keep what touches what. Bullet finds no contacts of a base that stands: its flag is that of `_enter`."""
        self._flags[1:] = read_contacts(self.world)[1:]

    def snapshot(self) -> bytes:
        """Layout, motor targets, contacts and Bullet's state with its contact memory."""
        if self.layout is None:
            raise CausalbenchError("call reset() before snapshot()")
        ours = np.array([*self._target, self._finger, *self._flags, *self._reference], dtype="<f8")
        return self._codec.pack(self.layout, ours.tobytes() + self.world.save())

    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot, bit for bit. Raises `SnapshotError`."""
        layout, state = self._codec.unpack(snapshot)
        world = self._enter(layout)
        size = 8 * (N_ARM + 1 + len(self._flags) + len(self._reference))
        ours = np.frombuffer(state[:size], "<f8")
        self._target[:], self._finger, rest = ours[:N_ARM], float(ours[N_ARM]), ours[N_ARM + 1 :]
        self._flags[:], self._reference[:] = rest[: len(self._flags)], rest[len(self._flags) :]
        world.load(state[size:])
        world.aim(self.motor_targets())

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB image (height, width, 3), see `Scene.render`."""
        return self.world.picture(width, height, find_camera(self.spec, camera))

    def close(self) -> None:
        """Free the simulator's world; may be called twice."""
        self._closed = True
        self._leave()

    def _leave(self) -> None:
        if self._world is not None:
            self._world.close()
            self._world = None

    def motor_targets(self) -> list[float]:
        """Where the motors of arm and fingers aim (9), rad and m."""
        return [*self._target.tolist(), self._finger, self._finger]

    def _enter(self, layout: Layout) -> World:
        """The world with base and boxes as in `layout`; boxes of other sizes or masses need another world."""
        if self._closed:
            raise CausalbenchError("the scene is closed")
        shapes = shapes_of(layout)
        if self._world is None or self._world.shapes != shapes:
            self._leave()
            self._world = self.world_type(self._robot, self.spec.timestep, self._iterations, shapes)
        self._world.place(layout)
        self.layout, self._base = layout, np.array(layout.base_pose, dtype=np.float64)
        self._flags[0] = self._world.base_touches()
        return self._world
