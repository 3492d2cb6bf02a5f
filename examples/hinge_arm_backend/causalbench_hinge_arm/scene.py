"""A six-hinge arm in plain MuJoCo behind the `Scene` contract."""

from __future__ import annotations

from importlib import metadata, resources

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from causalbench.core.kit import arm_ik, joint_following, stepping
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.numerics import rotations
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Layout, Workspace
from causalbench.core.world.scene import ACTION_SPEED, Scene, SceneSpec, check_action
from causalbench_hinge_arm import CAPABILITIES, ENGINE, ROBOT

Array = NDArray[np.float64]

ACTIONS = ("armx", "army", "armz", "armrx", "armry", "armrz", "grip")
CONTROL_DT, TIMESTEP = 0.1, 0.002  # s
ARM, FINGERS = slice(0, 6), slice(6, 8)  # in qpos and in ctrl alike
STROKE, GRIP_LEAD = 0.05, 0.015  # m: opening of each finger; how far a finger's target may run ahead
WORKSPACE = Workspace(0.6, (0.5, -0.15), (0.6, 0.15), (0.5, -0.2, 0.75), (0.8, 0.2, 1.0))
STARTS = [np.array([pan, lift, 1.6, 0.2, 0.0, 0.0]) for lift in (-0.8, -0.3) for pan in (0.0, -0.5, 0.5)]
"""Joint angles (rad), elbow up, from which a reset looks for its pose."""
OWN = {"pedestal", "upper", "forearm", "wrist", "palm", "left", "right"}
MJCF = resources.files(__package__).joinpath("arm.xml").read_text()
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


def _numbers(**values: ArrayLike) -> str:
    return " ".join(f'{name}="{" ".join(map(repr, np.asarray(value).tolist()))}"' for name, value in values.items())


def build(fixtures: tuple[Box, ...], target: Box, mass: float, base: Array) -> mujoco.MjModel:
    """The arm at `base` (x m, y m, yaw rad), the fixtures and the free box `target` of `mass` kg."""
    walls = "".join(
        f'<geom name="{box.name}" type="box" {_numbers(size=box.half_extents, pos=box.position, quat=box.quaternion)}/>'
        for box in fixtures
    )
    free = f'<geom name="target" type="box" mass="{mass!r}" {_numbers(size=target.half_extents)}/>'
    pose = _numbers(pos=target.position, quat=target.quaternion)
    return mujoco.MjModel.from_xml_string(
        MJCF.replace("BASE", _numbers(pos=[*base[:2], 0.0], quat=rotations.from_axis_angle(2, base[2])))
        .replace("TIMESTEP", repr(TIMESTEP))
        .replace("FIXTURES", walls)
        .replace("TARGET", f'<body name="target" {pose}><freejoint/>{free}</body>')
    )


def arm_chain() -> arm_ik.Chain:
    """The arm's kinematics, read from MuJoCo with all joints at 0 and the base at the origin."""
    nowhere = Box("target", np.full(3, 0.01), np.array([5.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0]))
    model = build((), nowhere, 0.1, np.zeros(3))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hand = data.site("eef")
    return arm_ik.chain_at_zero(
        data.xanchor[ARM], data.xaxis[ARM], model.jnt_range[ARM], hand.xpos, hand.xmat.reshape(3, 3)
    )


class HingeArmScene(Scene):
    """One MuJoCo world, kept after `mj_step1`: poses and contacts are those of the state."""

    def __init__(self) -> None:
        self.spec = SceneSpec(
            backend="hinge_arm",
            backend_version="0.1.0",
            engine=ENGINE,
            engine_version=metadata.version("mujoco"),
            robot=ROBOT,
            actions=ACTIONS,
            action_speed=tuple(ACTION_SPEED[name] for name in ACTIONS),
            workspace=WORKSPACE,
            max_opening=2 * STROKE,
            control_dt=CONTROL_DT,
            timestep=TIMESTEP,
            capabilities=CAPABILITIES,
        )
        self._codec, self._chain = SnapshotCodec(self.spec), arm_chain()
        substeps = stepping.whole_substeps(1 / CONTROL_DT, TIMESTEP)
        self._parts = stepping.target_parts(substeps, TIMESTEP)
        self._part = substeps // self._parts
        self._stride = np.array(self.spec.action_speed) * self._part * TIMESTEP

    def facts(self) -> Facts:
        """What holds now."""
        d, hand, box = self._data, self._data.site("eef"), self._data.body("target")
        touching = [{self._names[i] for i in pair} for pair in d.contact.geom]
        on_box = set().union(*(pair for pair in touching if "target" in pair))
        others = [pair for pair in touching if "target" not in pair]
        no = np.array(False)
        return Facts(
            eef_position=hand.xpos.copy(),
            eef_quaternion=rotations.canonical(rotations.from_matrix(hand.xmat.reshape(3, 3))),
            gripper_opening=np.array(d.qpos[FINGERS].sum()),
            holding=np.array({"left", "right"} <= on_box),
            object_position=box.xpos.copy(),
            object_quaternion=rotations.canonical(box.xquat),
            base_pose=np.array(self._layout.base_pose),
            base_velocity=np.zeros(2),
            collision_base=no,
            collision_arm=np.array(any(pair & OWN and not pair <= OWN for pair in others)),
            collision_self=np.array(any(pair <= OWN for pair in others)),
        )

    def _enter(self, layout: Layout) -> None:
        self._layout = layout
        self._model = build(layout.fixtures, layout.target, layout.target_mass, layout.base_pose)
        self._data = mujoco.MjData(self._model)
        self._names = [self._model.geom(i).name for i in range(self._model.ngeom)]

    def reset(self, layout: Layout) -> None:
        """Put the world into `layout`, at rest. Raises `UnreachableLayoutError`."""
        joints = arm_ik.reach(self._chain, layout, STARTS)
        self._enter(layout)
        d = self._data
        d.qpos[ARM] = d.ctrl[ARM] = joints
        d.qpos[FINGERS] = d.ctrl[FINGERS] = layout.gripper_opening / 2
        mujoco.mj_step(self._model, d, round(stepping.SETTLE / TIMESTEP))
        mujoco.mj_step1(self._model, d)
        stepping.check_settled(self.facts(), layout)

    def step(self, action: Array) -> None:
        """Advance by one control step; `action` (7,) in [-1, 1]. Raises `InvalidActionError`."""
        move = check_action(action, (len(ACTIONS),)) * self._stride
        d = self._data
        for _ in range(self._parts):
            joint_following.follow(self._chain, d.ctrl[ARM], d.qpos[ARM], move[:6], self._part * TIMESTEP)
            if move[6]:
                finger = d.qpos[FINGERS].mean()
                target = np.clip(d.ctrl[FINGERS] - move[6] / 2, finger - GRIP_LEAD, finger + GRIP_LEAD)
                d.ctrl[FINGERS] = np.clip(target, 0.0, STROKE)
            mujoco.mj_step(self._model, d, self._part)
        mujoco.mj_step1(self._model, d)

    def snapshot(self) -> bytes:
        """The layout and MuJoCo's integration state, which has the servo targets and the solver's warm start."""
        state = np.empty(mujoco.mj_stateSize(self._model, STATE))
        mujoco.mj_getState(self._model, self._data, state, STATE)
        return self._codec.pack(self._layout, state.tobytes())

    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot, also one of another process. Raises `SnapshotError`."""
        layout, state = self._codec.unpack(snapshot)
        self._enter(layout)
        mujoco.mj_setState(self._model, self._data, np.frombuffer(state).copy(), STATE)
        mujoco.mj_step1(self._model, self._data)
