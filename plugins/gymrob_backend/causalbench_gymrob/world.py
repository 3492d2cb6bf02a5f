"""A compiled model with its data, and the edits that put another layout into it without a new compilation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.layout import Box
from causalbench_gymrob import model as fetch
from causalbench_gymrob.engine import mujoco

Array = NDArray[np.float64]


class World:
    """Model, data, the addresses in them and views of them that stay valid while the world lives."""

    def __init__(self, timestep: float, n_fixtures: int) -> None:
        self.model = model = fetch.build(timestep, n_fixtures)
        self.data = data = mujoco.MjData(model)
        self.classes = fetch.geom_classes(model)
        self.model_address, self.data_address = model._address, data._address
        self.chain = fetch.arm_chain(model)
        self.arm = self._addresses(fetch.ARM_JOINTS)
        self.fingers = self._addresses(fetch.FINGER_JOINTS)
        self.base = self._addresses(fetch.BASE_JOINTS)
        self.arm_servos = self._servos(fetch.ARM_JOINTS)
        self.finger_servos = self._servos(fetch.FINGER_JOINTS)
        self.base_servos = self._servos(fetch.BASE_JOINTS)
        self.fixtures = [self._box(f"fixture{i}") for i in range(n_fixtures)]
        self.target = self._box(fetch.OBJECT)
        self.gap = self._closed_gap()
        self.qpos, self.qvel, self.ctrl = data.qpos, data.qvel, data.ctrl
        # The arm's joints and servos are contiguous: views, not copies.
        self.arm_joints = data.qpos[self.arm[0] : self.arm[-1] + 1]
        free = int(model.joint("object0:joint").qposadr[0])
        self.object_pose = data.qpos[free : free + 7]
        self.arm_target = data.ctrl[self.arm_servos[0] : self.arm_servos[-1] + 1]
        hand = model.site(fetch.EEF_SITE).id
        self.hand_position, self.hand_matrix = data.site_xpos[hand], data.site_xmat[hand]
        self.state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
        self._sizes: bytes = b""

    def _addresses(self, names: tuple[str, ...]) -> NDArray[np.int64]:
        return np.array([int(self.model.joint(name).qposadr[0]) for name in names])

    def _servos(self, names: tuple[str, ...]) -> NDArray[np.int64]:
        return np.array([self.model.actuator(name).id for name in names])

    def _closed_gap(self) -> float:
        """Distance in metres between the inner faces of the finger pads at joint positions 0."""
        inner = []
        for link in fetch.FINGERS:
            body, geom = self.model.body(link), self.model.geom(link)
            inner.append(abs(float(body.pos[1] + geom.pos[1])) - float(geom.size[1]))
        return sum(inner)

    def place_base(self, pose: Array) -> None:
        """Put the base at `pose` (3,) and let its servos hold it there."""
        self.qpos[self.base] = self.ctrl[self.base_servos] = pose

    def furnish(self, fixtures: tuple[Box, ...], target: Box, mass: float) -> None:
        """Give the fixtures their sizes and poses and the object its size and mass; as many as it was built with."""
        model = self.model
        for (body, geom), box in zip(self.fixtures, fixtures, strict=True):
            model.body_pos[body], model.body_quat[body] = box.position, box.quaternion
            self._resize(body, geom, box.half_extents)
        sizes = np.append(target.half_extents, mass).tobytes()
        if sizes == self._sizes:
            return
        body, geom = self.target
        self._resize(body, geom, target.half_extents)
        x, y, z = target.half_extents**2
        # The compiler orders principal axes by size; here they stay those of the box, whatever its sides.
        model.body_iquat[body] = [1.0, 0.0, 0.0, 0.0]
        model.body_inertia[body] = mass / 3 * np.array([y + z, x + z, x + y])
        model.body_mass[body] = mass
        mujoco.mj_setConst(model, self.data)  # what the solver derives from masses
        self._sizes = sizes

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
        """The whole state (n,), a view that the next call overwrites."""
        mujoco.mj_getState(self.model, self.data, self.state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return self.state

    def load(self, state: Array) -> None:
        """Return to a state (n,) of `save` and refresh what derives from it, as after a control step."""
        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_step1(self.model, self.data)
