"""`PandaWorld`: a compiled model with its data, and where in their arrays the control step finds the robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Layout, rotations
from causalbench_mujoco.arms import HAND, arm_chain, closed_gap
from causalbench_mujoco.bases import Base, FixedBase, JointBase
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.world import World
from causalbench_robosuite import model as panda
from causalbench_robosuite import structs

Indices = NDArray[np.int64]


class PandaWorld(World):
    """The Panda among `n_fixtures` fixtures, with `n_others` boxes beside the target.

    It is on its mount or, if it `drives`, on the PandaOmron's base.
    """

    def __init__(self, timestep: float, n_fixtures: int, n_others: int = 0, drives: bool = False) -> None:
        model = panda.build(timestep, n_fixtures, n_others, drives)
        data = mujoco.MjData(model)
        self.robot = robot_addresses(model)
        base: Base = FixedBase(model, panda.ROOT)
        if drives:
            base = JointBase(model, data, panda.BASE_JOINTS, panda.BASE_SERVOS, drives)
            self.robot = self.robot._replace(base=base.joints)
        chain = arm_chain(model, panda.ARM_JOINTS, panda.LIMIT_MARGIN)
        super().__init__(model, data, base, panda.geom_classes(model), chain, closed_gap(model, panda.PADS))
        self.views = views(model, data)
        self.frame = structs.Base(np.zeros(3), np.eye(3))

    def furnish(self, layout: Layout) -> None:
        super().furnish(layout)
        self.frame.position[:2] = layout.base_pose[:2]
        self.frame.rotation[:] = rotations.matrix(rotations.from_axis_angle(2, layout.base_pose[2]))


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
        site=model.site(HAND).id,
        inertia=np.array([[inertia(max(a, b), min(a, b)) for b in dofs] for a in dofs]),
        ctrl_range=model.actuator_ctrlrange.copy(),
        finger_damping=float(model.dof_damping[finger_dofs[0]]),
        finger_friction=float(model.dof_frictionloss[finger_dofs[0]]),
        finger_kp=float(model.actuator_gainprm[servos[0], 0]),
        finger_range=np.array(panda.FINGER_RANGE),
    )


def views(model: mujoco.MjModel, data: mujoco.MjData) -> structs.State:
    """The arrays of `data` that the control step reads and writes."""
    hand = model.site(HAND).id
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
