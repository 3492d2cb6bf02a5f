"""A compiled model with its data, and the edits that put another layout into it without a new compilation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.world.layout import Box
from causalbench_robosuite import model as panda
from causalbench_robosuite import structs
from causalbench_robosuite.engine import mujoco

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class World:
    """Model, data, the addresses in them and views of them that stay valid while the world lives."""

    def __init__(self, timestep: float, n_fixtures: int) -> None:
        self.model = model = self.build(timestep, n_fixtures)
        self.data = data = mujoco.MjData(model)
        self.classes = panda.geom_classes(model)
        self.chain = panda.arm_chain(model)
        self.robot = robot_addresses(model)
        self.views = views(model, data)
        free = int(model.joint(panda.OBJECT).qposadr[0])
        self.object_pose = data.qpos[free : free + 7]
        self.fixtures = [self._box(f"fixture{i}") for i in range(n_fixtures)]
        self.target = self._box(panda.OBJECT)
        self.gap = self._closed_gap()
        self.reference = structs.Reference(np.zeros(7), np.zeros(1), np.zeros(3), np.eye(3))
        self.base = structs.Base(np.zeros(3), np.eye(3))
        self._base_pose = np.zeros(3)
        self._root = model.body(panda.ROOT).id
        self._state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
        self._sizes: bytes = b""

    @staticmethod
    def build(timestep: float, n_fixtures: int) -> mujoco.MjModel:
        """The model, see `model.build`."""
        return panda.build(timestep, n_fixtures)

    def _closed_gap(self) -> float:
        """Distance in metres between the inner faces of the finger pads at joint positions 0."""
        inner = []
        for name in panda.PADS:
            geom = self.model.geom(name)
            tip = self.model.body(int(geom.bodyid[0]))
            inner.append(abs(float(tip.pos[1] + geom.pos[1])) - float(geom.size[1]))
        return sum(inner)

    def furnish(self, base_pose: Array, fixtures: tuple[Box, ...], target: Box, mass: float) -> None:
        """Place the base and the fixtures, give all boxes their sizes and the object its mass.

        There must be as many fixtures as the world was built with.
        """
        model = self.model
        sizes = np.append(target.half_extents, mass).tobytes()
        if sizes != self._sizes:
            body, geom = self.target
            self._resize(body, geom, target.half_extents)
            x, y, z = target.half_extents**2
            # The compiler orders principal axes by size; here they stay those of the box, whatever its sides.
            model.body_iquat[body] = [1.0, 0.0, 0.0, 0.0]
            model.body_inertia[body] = mass / 3 * np.array([y + z, x + z, x + y])
            model.body_mass[body] = mass
            self.place_base(np.zeros(3))  # so that what is derived does not depend on where the base was before
            mujoco.mj_setConst(model, self.data)  # what the solver derives from masses
            self._sizes = sizes
        self.place_base(base_pose)
        for (body, geom), box in zip(self.fixtures, fixtures, strict=True):
            model.body_pos[body], model.body_quat[body] = box.position, box.quaternion
            self._resize(body, geom, box.half_extents)

    def base_state(self) -> tuple[Array, Array]:
        """Pose (3,) and velocity (2,) of the base, see `Facts`; the caller's own."""
        return self._base_pose.copy(), np.zeros(2)

    def place_base(self, base_pose: Array) -> None:
        """Stand the mount at (x m, y m, yaw rad)."""
        self._base_pose[:] = base_pose
        quaternion = rotations.from_axis_angle(2, base_pose[2])
        self.model.body_pos[self._root, :2] = self.base.position[:2] = base_pose[:2]
        self.model.body_quat[self._root] = quaternion
        self.base.rotation[:] = rotations.matrix(quaternion)

    def _box(self, name: str) -> tuple[int, int]:
        """Indices of the body and of the geom `name`."""
        return self.model.body(name).id, self.model.geom(name).id

    def _resize(self, body: int, geom: int, half_extents: Array) -> None:
        """A box geom's size and the bounding volumes that the compiler derived from it."""
        model = self.model
        model.geom_size[geom] = half_extents
        model.geom_rbound[geom] = np.sqrt((half_extents**2).sum())
        model.geom_aabb[geom] = model.bvh_aabb[model.body_bvhadr[body]] = [0.0, 0.0, 0.0, *half_extents]

    def save(self) -> Array:
        """The whole state (n,): the controller's memory and MuJoCo's integration state."""
        mujoco.mj_getState(self.model, self.data, self._state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return np.concatenate([self.reference.joints, self.reference.finger, self._state])

    def load(self, state: Array) -> None:
        """Return to a state (n,) of `save` and refresh what derives from it, as after a control step."""
        n = len(self.reference.joints)
        self.reference.joints[:], self.reference.finger[:] = state[:n], state[n]
        mujoco.mj_setState(self.model, self.data, state[n + 1 :], mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_step1(self.model, self.data)


def robot_addresses(model: mujoco.MjModel) -> structs.Robot:
    """Where the robot is in a model with the stripped Panda."""

    def gather(field: str, names: tuple[str, ...]) -> Indices:
        return np.array([int(getattr(model.joint(name), field)[0]) for name in names])

    def actuators(names: tuple[str, ...]) -> Indices:
        return np.array([model.actuator(name).id for name in names])

    def inertia(dof: int, other: int) -> int:
        """Where M[dof, other] is in MuJoCo's sparse inertia: a row goes from its dof to its ancestors."""
        address = int(model.dof_Madr[dof])
        while dof != other:
            dof, address = int(model.dof_parentid[dof]), address + 1
        return address

    dofs = gather("dofadr", panda.ARM_JOINTS)
    finger_dofs, servos = gather("dofadr", panda.FINGER_JOINTS), actuators(panda.FINGER_SERVOS)
    return structs.Robot(
        base=np.zeros(0, dtype=np.int64),
        joints=gather("qposadr", panda.ARM_JOINTS),
        dofs=dofs,
        motors=actuators(panda.ARM_MOTORS),
        fingers=gather("qposadr", panda.FINGER_JOINTS),
        finger_dofs=finger_dofs,
        servos=servos,
        site=model.site(panda.EEF_SITE).id,
        inertia=np.array([[inertia(max(a, b), min(a, b)) for b in dofs] for a in dofs]),
        ctrl_range=model.actuator_ctrlrange.copy(),
        finger_damping=float(model.dof_damping[finger_dofs[0]]),
        finger_friction=float(model.dof_frictionloss[finger_dofs[0]]),
        finger_kp=float(model.actuator_gainprm[servos[0], 0]),
        finger_range=np.array(panda.FINGER_RANGE),
    )


def views(model: mujoco.MjModel, data: mujoco.MjData) -> structs.State:
    """The arrays of `data` that the control step reads and writes."""
    hand = model.site(panda.EEF_SITE).id
    return structs.State(
        qpos=data.qpos,
        qvel=data.qvel,
        ctrl=data.ctrl,
        bias=data.qfrc_bias,
        inertia=data.qM,
        position=data.site_xpos[hand],
        matrix=data.site_xmat[hand],
        jacobian=np.zeros((2, 3, model.nv)),
    )
