"""`GymrobScene`: Fetch behind the `Scene` contract. The model is in `model.py`; core's `readings.py` reads it."""

from __future__ import annotations

import math
from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import arm_ik, stepping
from causalbench.core.kit import contacts as readings
from causalbench.core.kit.robots.fetch import ACTIONS, ARM_STARTS, FINGER_STROKE, WORKSPACE
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.world.cameras import find_camera
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import ACTION_SPEED, Scene, SceneSpec, check_action
from causalbench.errors import CausalbenchError
from causalbench_gymrob import CAPABILITIES, __version__, control
from causalbench_gymrob.engine import mujoco
from causalbench_gymrob.world import World

Array = NDArray[np.float64]


class GymrobScene(Scene):
    """Fetch and one free box among fixtures. Holds the state after `mj_step1`: poses and contacts are fresh."""

    world_type: type[World] = World

    def __init__(self, control_hz: float = 10.0, timestep: float = 0.005) -> None:
        self.substeps = stepping.whole_substeps(control_hz, timestep)
        self._world = self.world_type(timestep, n_fixtures=1)
        self.spec = SceneSpec(
            backend="gymrob",
            backend_version=__version__,
            engine="MuJoCo",
            engine_version=metadata.version("mujoco"),
            robot="Fetch",
            actions=ACTIONS,
            action_speed=tuple(ACTION_SPEED[name] for name in ACTIONS),
            workspace=WORKSPACE,
            max_opening=self._world.gap + 2 * FINGER_STROKE,
            control_dt=self.substeps * timestep,
            timestep=timestep,
            capabilities=CAPABILITIES,
        )
        self._codec = SnapshotCodec(self.spec)
        self._parts = stepping.target_parts(self.substeps, timestep)
        self._part = self.substeps // self._parts  # substeps
        self._stride = np.array(self.spec.action_speed) * self._part * timestep
        self._layout: Layout | None = None
        self._memory = np.zeros(2)  # what MuJoCo's state does not hold
        self._pad_forces = self._memory[:2]

    def reset(self, layout: Layout) -> None:
        """Put the world into `layout`, at rest.

        Raises `UnreachableLayoutError` when the arm cannot take the pose, or when the start is not at rest because
        things overlap.
        """
        joints = arm_ik.reach(self._world.chain, layout, ARM_STARTS)
        self._enter(layout)
        world = self._world
        mujoco.mj_resetData(world.model, world.data)
        finger = min(max((layout.gripper_opening - world.gap) / 2, 0.0), FINGER_STROKE)
        world.place_base(layout.base_pose)
        for address, servo, value in (
            (world.arm, world.arm_servos, joints),
            (world.fingers, world.finger_servos, finger),
        ):
            world.qpos[address] = value
            world.ctrl[servo] = value
        world.object_pose[:3], world.object_pose[3:] = layout.target.position, layout.target.quaternion
        mujoco.mj_step(world.model, world.data, max(1, round(stepping.SETTLE / self.spec.timestep)))
        world.data.time = 0.0
        self._refresh()
        stepping.check_settled(self.facts(), layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` (7,) in [-1, 1]. Raises `InvalidActionError`."""
        delta = check_action(action, (len(ACTIONS),)) * self._stride
        w = self._world
        control.control_step(
            w.model_address, w.data_address, self._parts, self._part, delta, self._part * self.spec.timestep,
            w.chain, w.arm_target, w.arm_joints, w.qpos, w.ctrl, w.fingers, w.finger_servos,
        )  # fmt: skip
        self._refresh()

    def facts(self) -> Facts:
        """What holds now. `holding` goes by the pad forces of the last substep, all else by the state after it."""
        w = self._world
        x, flags = np.empty(14), np.empty(4, dtype=np.bool_)
        readings.read(
            w.data.contact.geom, w.classes, self._pad_forces, w.hand_position, w.hand_matrix, w.object_pose, x, flags
        )
        left, right = w.fingers
        base, velocity = w.qpos[w.base], w.qvel[w.base]
        yaw = float(base[2])
        return Facts(
            eef_position=x[0:3],
            eef_quaternion=x[3:7],
            gripper_opening=w.qpos[left] + w.qpos[right] + w.gap,
            holding=flags[3],
            object_position=x[7:10],
            object_quaternion=x[10:14],
            base_pose=base,
            base_velocity=np.array([math.cos(yaw) * velocity[0] + math.sin(yaw) * velocity[1], velocity[2]]),
            collision_base=flags[0],
            collision_arm=flags[1],
            collision_self=flags[2],
        )

    def snapshot(self) -> bytes:
        """Layout, MuJoCo's integration state (servo targets included) and the pad forces."""
        if self._layout is None:
            raise CausalbenchError("call reset() before snapshot()")
        return self._codec.pack(self._layout, np.concatenate([self._memory, self._world.save()]).tobytes())

    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot, bit for bit. Raises `SnapshotError`."""
        layout, packed = self._codec.unpack(snapshot)
        state = np.frombuffer(packed).copy()  # MuJoCo takes no read-only memory
        self._enter(layout)
        self._world.load(state[len(self._memory) :])
        self._memory[:] = state[: len(self._memory)]

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB image (height, width, 3), see `Scene.render`."""
        from causalbench_gymrob.picture import draw  # which needs OpenGL

        return draw(self.model, self.data, width, height, find_camera(self.spec, camera))

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, for measurements; a layout with another number of fixtures replaces it."""
        return self._world.model

    @property
    def data(self) -> mujoco.MjData:
        """The simulator's data, for measurements; a layout with another number of fixtures replaces it."""
        return self._world.data

    def _enter(self, layout: Layout) -> None:
        """Give the world the boxes of `layout`; another number of fixtures needs another model."""
        if len(layout.fixtures) != len(self._world.fixtures):
            self._world = self.world_type(self.spec.timestep, len(layout.fixtures))
        self._world.furnish(layout.fixtures, layout.target, layout.target_mass)
        self._layout = layout

    def _refresh(self) -> None:
        """Keep the forces of the substep just solved, then bring poses and contacts up to the new positions."""
        world, data = self._world, self._world.data
        contact = data.contact
        readings.pad_forces(
            contact.geom, contact.efc_address, contact.frame, data.efc_force, world.hand_matrix, world.classes,
            self._pad_forces,
        )  # fmt: skip
        mujoco.mj_step1(world.model, data)
