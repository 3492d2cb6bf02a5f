"""`World`: a compiled model with its data, and what a scene needs to know of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Layout, arm_ik
from causalbench_mujoco.arms import HAND
from causalbench_mujoco.bases import Base
from causalbench_mujoco.boxes import Boxes
from causalbench_mujoco.contacts import Indices
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.states import STATE

Array = NDArray[np.float64]


class World:
    """One model and its data. Arrays named here are views of the data, valid while the world lives.

    `classes` (ngeom,) are those of `contacts`; `chain` is the arm in the base frame; `gap` m is between closed pads.
    Backends subclass it for the addresses that their control needs.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, base: Base, classes: Indices, chain: arm_ik.Chain, gap: float
    ) -> None:
        self.model, self.data, self.base = model, data, base
        self.classes, self.chain, self.gap = classes, chain, gap
        self.boxes = Boxes(model, data)
        hand = int(model.site(HAND).id)
        self.hand_position, self.hand_matrix = data.site_xpos[hand], data.site_xmat[hand]  # (3,), (9,)
        self.qpos, self.qvel, self.ctrl = data.qpos, data.qvel, data.ctrl
        self._state = np.empty(mujoco.mj_stateSize(model, STATE))

    def furnish(self, layout: Layout) -> None:
        """Give base and boxes the sizes, masses and places of `layout`; they are as many as the model's."""
        self.boxes.place(layout.fixtures)
        if self.boxes.shape(layout):
            self.base.place(np.zeros(3))  # so that what is derived does not depend on where the base was before
            mujoco.mj_setConst(self.model, self.data)
        self.base.place(layout.base_pose)

    def save(self) -> Array:
        """MuJoCo's whole state (n,); the next call overwrites it."""
        mujoco.mj_getState(self.model, self.data, self._state, STATE)
        return self._state

    def load(self, state: Array) -> None:
        """Return to a state (n,) of `save`, and refresh what derives from it as after a control step."""
        mujoco.mj_setState(self.model, self.data, state, STATE)
        mujoco.mj_step1(self.model, self.data)

    def joint_addresses(self, names: Sequence[str]) -> Indices:
        """Where joints are in qpos."""
        return np.array([int(self.model.joint(name).qposadr[0]) for name in names])

    def actuator_addresses(self, names: Sequence[str]) -> Indices:
        """Where actuators are in ctrl."""
        return np.array([int(self.model.actuator(name).id) for name in names])
