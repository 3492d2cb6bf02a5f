"""`RobosuiteScene`: robosuite's Panda behind the `Scene` contract."""

from __future__ import annotations

from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import arm_ik, stepping
from causalbench.core.kit import contacts as readings
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.world.cameras import find_camera
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.core.world.scene import ACTION_SPEED, Scene, SceneSpec, check_action
from causalbench.errors import CausalbenchError
from causalbench_robosuite import CAPABILITIES, __version__, control, structs
from causalbench_robosuite.engine import mujoco
from causalbench_robosuite.model import FINGER_STROKE, gains
from causalbench_robosuite.world import World

Array = NDArray[np.float64]

ACTIONS = ("armx", "army", "armz", "armrx", "armry", "armrz", "grip")
WORKSPACE = Workspace(
    table_height=1.25,
    object_low=(0.46, -0.15),
    object_high=(0.54, 0.15),
    hand_low=(0.45, -0.20, 1.42),
    hand_high=(0.62, 0.20, 1.58),
)
"""Result of `python -m causalbench_robosuite.reach_scan`; see the README."""

UNCOUPLED = False  # robosuite's option `uncouple_pos_ori`: on, a hand that starts to sink tilts by 0.1 rad
LEAD, TURN_LEAD = 0.015, 0.06  # m, rad by which the hand's reference may run ahead: what a reversal needs
GRIP_LEAD = 0.015  # m by which a finger's target may run ahead of the finger: 15 N of grip
ARM_STARTS = tuple(
    np.array([pan, shoulder, 0.0, elbow, 0.0, wrist, np.pi / 4 + pan])
    for shoulder, elbow, wrist in ((0.0, -2.0, 2.5), (0.4, -1.6, 2.2), (-0.4, -2.4, 2.5))
    for pan in (0.0, -0.4, 0.4)
)
"""Joint angles (rad) from which a reset looks for its pose, elbow up, in this order."""


class RobosuiteScene(Scene):
    """The Panda and one free box among fixtures. Holds the state after `mj_step1`: poses and contacts are fresh."""

    world_type: type[World] = World
    robot, workspace = "Panda", WORKSPACE

    def __init__(self, control_hz: float = 10.0, timestep: float = 0.002) -> None:
        self.substeps = stepping.whole_substeps(control_hz, timestep)
        self._world = self.world_type(timestep, n_fixtures=1)
        self.spec = SceneSpec(
            backend="robosuite",
            backend_version=__version__,
            engine="MuJoCo",
            engine_version=metadata.version("mujoco"),
            robot=self.robot,
            actions=ACTIONS,
            action_speed=tuple(ACTION_SPEED[name] for name in ACTIONS),
            workspace=self.workspace,
            max_opening=self._world.gap + 2 * FINGER_STROKE,
            control_dt=self.substeps * timestep,
            timestep=timestep,
            capabilities=CAPABILITIES,
        )
        self._codec = SnapshotCodec(self.spec)
        self._law = structs.Law(*gains(), UNCOUPLED, LEAD, TURN_LEAD, GRIP_LEAD)
        self._parts = stepping.target_parts(self.substeps, timestep)
        self._part = self.substeps // self._parts  # substeps
        self._stride = np.array(self.spec.action_speed) * self._part * timestep
        self._layout: Layout | None = None
        self._memory = np.zeros(2)  # what the world does not hold
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
        world.place_base(layout.base_pose)
        finger = min(max((layout.gripper_opening - world.gap) / 2, 0.0), FINGER_STROKE)
        qpos = world.views.qpos
        qpos[world.robot.joints] = joints
        qpos[world.robot.fingers] = finger, -finger
        world.object_pose[:3], world.object_pose[3:] = layout.target.position, layout.target.quaternion
        world.views.ctrl[world.robot.servos] = finger, -finger
        world.reference.joints[:], world.reference.finger[:] = joints, finger
        mujoco.mj_step1(world.model, world.data)
        self._run(np.zeros(len(ACTIONS)), 1, max(1, round(stepping.SETTLE / self.spec.timestep)))
        world.data.time = 0.0
        stepping.check_settled(self.facts(), layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` (7,) in [-1, 1]. Raises `InvalidActionError`."""
        self._run(check_action(action, (len(ACTIONS),)) * self._stride, self._parts, self._part)

    def facts(self) -> Facts:
        """What holds now. `holding` goes by the pad forces of the last substep, all else by the state after it."""
        w = self._world
        x, flags = np.empty(14), np.empty(4, dtype=np.bool_)
        readings.read(
            w.data.contact.geom, w.classes, self._pad_forces, w.views.position, w.views.matrix, w.object_pose, x, flags
        )
        first, second = w.robot.fingers
        base_pose, base_velocity = w.base_state()
        return Facts(
            eef_position=x[0:3],
            eef_quaternion=x[3:7],
            gripper_opening=np.maximum(w.views.qpos[first] - w.views.qpos[second] + w.gap, 0.0),
            holding=flags[3],
            object_position=x[7:10],
            object_quaternion=x[10:14],
            base_pose=base_pose,
            base_velocity=base_velocity,
            collision_base=flags[0],
            collision_arm=flags[1],
            collision_self=flags[2],
        )

    def snapshot(self) -> bytes:
        """Layout, the pad forces, the controller's memory and MuJoCo's integration state."""
        if self._layout is None:
            raise CausalbenchError("call reset() before snapshot()")
        state: bytes = np.concatenate([self._memory, self._world.save()]).astype("<f8").tobytes()
        return self._codec.pack(self._layout, state)

    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot, bit for bit. Raises `SnapshotError`."""
        layout, packed = self._codec.unpack(snapshot)
        state = np.frombuffer(packed, "<f8").astype(np.float64)
        self._enter(layout)
        self._world.load(state[len(self._memory) :])
        self._memory[:] = state[: len(self._memory)]

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB image (height, width, 3), see `Scene.render`."""
        from causalbench_robosuite.picture import draw  # which needs OpenGL

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
        """Give the world the base and the boxes of `layout`; another number of fixtures needs another model."""
        if len(layout.fixtures) != len(self._world.fixtures):
            self._world = self.world_type(self.spec.timestep, len(layout.fixtures))
        self._world.furnish(layout.base_pose, layout.fixtures, layout.target, layout.target_mass)
        self._layout = layout

    def _run(self, delta: Array, parts: int, substeps: int) -> None:
        """Run the controller, keep the forces of the last substep, then bring poses and contacts up to date."""
        w = self._world
        control.control_step(
            w.model._address, w.data._address, parts, substeps, delta, self.spec.timestep,
            w.chain, w.base, w.robot, self._law, w.reference, w.views,
        )  # fmt: skip
        contact = w.data.contact
        readings.pad_forces(
            contact.geom, contact.efc_address, contact.frame, w.data.efc_force, w.views.matrix, w.classes,
            self._pad_forces,
        )  # fmt: skip
        mujoco.mj_step1(w.model, w.data)
