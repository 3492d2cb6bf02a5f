"""`MujocoScene`: the scene of a backend over MuJoCo, but for its robot."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections.abc import Sequence
from importlib import metadata
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import (
    ACTION_SPEED,
    ARM_ACTIONS,
    Capability,
    CausalbenchError,
    Facts,
    Layout,
    Scene,
    SceneSpec,
    SnapshotCodec,
    Workspace,
    arm_ik,
    base_following,
    check_action,
    check_layout,
    find_camera,
    rotations,
    stepping,
)
from causalbench_mujoco import contacts
from causalbench_mujoco.bases import JointBase
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.rays import Scanner
from causalbench_mujoco.world import World

Array = NDArray[np.float64]
WorldT = TypeVar("WorldT", bound=World)

PADS, REFERENCE = 2, 3  # numbers that the memory of a scene holds of the pads' forces and of the base's reference


def arm_spec(
    backend: str,
    version: str,
    robot: str,
    workspace: Workspace,
    max_opening: float,
    control_hz: float,
    timestep: float,
    capabilities: frozenset[Capability],
    lidar_position: tuple[float, float, float] | None = None,
) -> SceneSpec:
    """The spec of an arm on a base that stands, with all actions of the arm at their default speeds.

    `version` is the backend's own; `lidar_position` goes with the capability `LIDAR`. Raises `UserError` unless a
    control step takes a whole number of timesteps.
    """
    return SceneSpec(
        backend=backend,
        backend_version=version,
        engine="MuJoCo",
        engine_version=metadata.version("mujoco"),
        robot=robot,
        actions=ARM_ACTIONS,
        action_speed=tuple(ACTION_SPEED[name] for name in ARM_ACTIONS),
        workspace=workspace,
        max_opening=max_opening,
        control_dt=stepping.whole_substeps(control_hz, timestep) * timestep,
        timestep=timestep,
        capabilities=capabilities,
        lidar_position=lidar_position,
    )


def squeeze(layout: Layout) -> float:
    """Metres by which the opening of a start is narrower than the box that the hand is around; 0 where it is none.

    Such a start holds the box: fingers begin on its sides and close by as much.
    """
    for box in (layout.target, *layout.others):
        back = rotations.conjugate(box.quaternion)
        inside = np.abs(rotations.rotate(back, layout.eef_position - box.position)) < box.half_extents
        if inside.all():
            along = rotations.rotate(rotations.multiply(back, layout.eef_quaternion), np.array([0.0, 1.0, 0.0]))
            return max(2.0 * float(np.abs(along) @ box.half_extents) - layout.gripper_opening, 0.0)
    return 0.0


class MujocoScene(Scene, Generic[WorldT]):
    """A robot and free boxes among fixtures, kept after `mj_step1`: poses and contacts are those of the state.

    A backend says how to make a world (`build`), how to pose its arm (`pose`) and how to control it (`advance`,
    `opening`). `memory` (n_memory,) is its own to use for what its control remembers beside MuJoCo's state: snapshots
    keep it. With `MOBILE_BASE` in the spec the world's base is a `JointBase` that drives; a scene with `LIDAR` scans.
    """

    def __init__(
        self, spec: SceneSpec, world: WorldT, starts: Sequence[Array], stroke: float, n_memory: int = 0
    ) -> None:
        """`starts` (n,) rad are where the joint angles of a reset are searched from, `stroke` m opens each finger."""
        self.spec, self.world = spec, world
        self.substeps = stepping.whole_substeps(1 / spec.control_dt, spec.timestep)
        self._starts, self._stroke = starts, stroke
        self._codec = SnapshotCodec(spec)
        self._parts = stepping.target_parts(self.substeps, spec.timestep)
        self._part = self.substeps // self._parts  # substeps
        self._drives = Capability.MOBILE_BASE in spec.capabilities
        self._stride = np.array(spec.action_speed[-len(ARM_ACTIONS) :]) * self._part * spec.timestep
        self._way = base_following.SPEED * spec.control_dt
        held = REFERENCE if self._drives else 0
        self._memory = np.zeros(PADS + held + n_memory)  # what MuJoCo's state does not hold
        self._pad_forces, self._reference = self._memory[:PADS], self._memory[PADS : PADS + held]
        self.memory = self._memory[PADS + held :]
        self._scanner: Scanner | None = None
        self._use(world)

    @abstractmethod
    def build(self, n_fixtures: int, n_others: int) -> WorldT:
        """A new world with that many fixtures and free boxes beside the target."""

    @abstractmethod
    def pose(self, joints: Array, finger: float) -> None:
        """Put the arm's joints at `joints` (n,) rad and both fingers open by `finger` m, targets alike."""

    @abstractmethod
    def advance(self, delta: Array, parts: int, substeps: int) -> None:
        """Advance by `parts` times `substeps` timesteps; in each part the hand's reference moves by `delta` (7,).

        Metres along the base's axes, radians about the hand's own axes, metres of closing. Called after `mj_step1`;
        leaves as `mj_step` does.
        """

    @abstractmethod
    def opening(self) -> float:
        """Distance in metres between the finger pads."""

    def reset(self, layout: Layout) -> None:
        """Put the world into `layout`, at rest.

        Raises `UnreachableLayoutError` when the arm cannot take the pose, or when the start is not at rest because
        things overlap.
        """
        check_layout(layout, self.spec)
        joints = arm_ik.reach(self.world.chain, layout, self._starts)
        self._enter(layout)
        world = self.world
        mujoco.mj_resetData(world.model, world.data)
        world.base.place(layout.base_pose)
        if self._drives:
            self._reference[:] = layout.base_pose
        squeezed = squeeze(layout)
        opening = layout.gripper_opening + squeezed
        self.pose(joints, min(max((opening - world.gap) / 2, 0.0), self._stroke))
        world.boxes.put(layout)
        mujoco.mj_step1(world.model, world.data)
        closing = np.append(np.zeros(len(ARM_ACTIONS) - 1), squeezed)
        self._run(closing, 1, max(1, round(stepping.SETTLE / self.spec.timestep)))
        world.data.time = 0.0
        stepping.check_settled(self.facts(), layout)

    def step(self, action: Array) -> None:
        """Advance by one `spec.control_dt`; `action` as `spec.actions`, in [-1, 1]. Raises `InvalidActionError`."""
        action = check_action(action, (len(self.spec.actions),))
        if self._drives:
            self._drive(action[:2] * self._way)
            action = action[2:]
        self._run(action * self._stride, self._parts, self._part)

    def _drive(self, way: Array) -> None:
        base = self.world.base
        assert isinstance(base, JointBase)
        base.drive(base_following.follow(self._reference, base.pose(), way, self.spec.control_dt))

    def _run(self, delta: Array, parts: int, substeps: int) -> None:
        """Control, keep the forces of the last substep, then bring poses and contacts up to the new positions."""
        self.advance(delta, parts, substeps)
        world, data = self.world, self.world.data
        contact = data.contact
        contacts.pad_forces(
            contact.geom, contact.efc_address, contact.frame, data.efc_force, world.hand_matrix, world.classes,
            self._pad_forces,
        )  # fmt: skip
        mujoco.mj_step1(world.model, data)

    def facts(self) -> Facts:
        """What holds now. `holding` goes by the pad forces of the last substep, all else by the state after it."""
        w = self.world
        x, flags = np.empty(14), np.empty(4, dtype=np.bool_)
        contacts.read(
            w.data.contact.geom, w.classes, self._pad_forces, w.hand_position, w.hand_matrix, w.boxes.pose, x, flags
        )
        facts = Facts(
            eef_position=x[0:3],
            eef_quaternion=x[3:7],
            gripper_opening=np.array(self.opening()),
            holding=flags[3],
            object_position=x[7:10],
            object_quaternion=x[10:14],
            base_pose=w.base.pose(),
            base_velocity=w.base.velocity(),
            collision_base=flags[0],
            collision_arm=flags[1],
            collision_self=flags[2],
        )
        if not w.boxes.other_poses:
            return facts
        others = np.array(w.boxes.other_poses)
        turns = rotations.canonical(others[:, 3:])
        return dataclasses.replace(facts, other_positions=others[:, :3].copy(), other_quaternions=turns)

    def snapshot(self) -> bytes:
        """Layout, MuJoCo's integration state (servo targets included) and what it does not hold."""
        if self.layout is None:
            raise CausalbenchError("call reset() before snapshot()")
        return self._codec.pack(self.layout, np.concatenate([self._memory, self.world.save()]).tobytes())

    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot, bit for bit. Raises `SnapshotError`."""
        layout, packed = self._codec.unpack(snapshot)
        state = np.frombuffer(packed).copy()  # MuJoCo takes no read-only memory
        self._enter(layout)
        self.world.load(state[len(self._memory) :])
        self._memory[:] = state[: len(self._memory)]

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB image (height, width, 3), see `Scene.render`."""
        from causalbench_mujoco.picture import draw  # which needs OpenGL

        return draw(self.model, self.data, width, height, find_camera(self.spec, camera))

    def lidar(self) -> Array:
        """Ranges (220,) in metres, see `Scene.lidar`."""
        if self._scanner is None or self.spec.lidar_position is None:
            return super().lidar()
        return self._scanner.scan(self.world.base.pose(), self.spec.lidar_position)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, for measurements; a layout with other numbers of boxes replaces it."""
        return self.world.model

    @property
    def data(self) -> mujoco.MjData:
        """The simulator's data, for measurements; a layout with other numbers of boxes replaces it."""
        return self.world.data

    def _enter(self, layout: Layout) -> None:
        """Give the world the base and the boxes of `layout`; other numbers of boxes need another model."""
        if not self.world.boxes.fits(layout):
            self._use(self.build(len(layout.fixtures), len(layout.others)))
        self.world.furnish(layout)
        self.layout = layout

    def _use(self, world: WorldT) -> None:
        self.world = world
        if Capability.LIDAR in self.spec.capabilities:
            self._scanner = Scanner(world.model, world.data, world.classes)
