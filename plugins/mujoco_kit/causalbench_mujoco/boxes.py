"""The boxes of a layout in a model: fixtures that are moved and resized, and the target, which is free.

A model is compiled with as many fixtures as a layout has; all else about boxes is edited in place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Box
from causalbench_mujoco.engine import mujoco

Array = NDArray[np.float64]

TARGET = "object0"
"""Name of the target's body and of its only geom, in every model."""
FIXTURE_COLOUR, TARGET_COLOUR = (0.75, 0.7, 0.62, 1.0), (0.85, 0.2, 0.1, 1.0)
TARGET_FRICTION = (1.0, 0.02, 0.001)


def add_fixtures(spec: mujoco.MjSpec, count: int, **geom: Any) -> None:
    """Add `count` static boxes of placeholder size; `geom` are further attributes of their geoms, such as friction."""
    for i in range(count):
        # A body of its own: sizes and poses set later then touch one bounding volume only.
        spec.worldbody.add_body(name=f"fixture{i}").add_geom(
            name=f"fixture{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], rgba=FIXTURE_COLOUR, **geom
        )


def add_target(spec: mujoco.MjSpec) -> None:
    """Add the free box of placeholder size, well above everything."""
    body = spec.worldbody.add_body(name=TARGET, pos=[0.0, 0.0, 3.0])
    body.add_freejoint(name=TARGET)
    body.add_geom(
        name=TARGET, type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02], condim=4, friction=TARGET_FRICTION,
        rgba=TARGET_COLOUR,
    )  # fmt: skip


class Boxes:
    """Those of one compiled model: `n_fixtures` fixtures and the target, whose pose in the state is the view `pose`."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        self._fixtures = [int(body) for body in range(model.nbody) if model.body(body).name.startswith("fixture")]
        self._target = int(model.body(TARGET).id)
        geom = int(model.body_geomadr[self._target])
        self._touches = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        address = int(model.jnt_qposadr[model.body_jntadr[self._target]])
        self.pose = data.qpos[address : address + 7]
        self.n_fixtures = len(self._fixtures)
        self._shape = b""

    def place(self, fixtures: tuple[Box, ...]) -> None:
        """Give the fixtures their sizes and poses; as many as the model was compiled with."""
        for body, box in zip(self._fixtures, fixtures, strict=True):
            self._model.body_pos[body], self._model.body_quat[body] = box.position, box.quaternion
            self._resize(body, box.half_extents)

    def shape(self, target: Box, mass: float) -> bool:
        """Give the target its size and mass in kg, and say whether they are new.

        If they are, `mujoco.mj_setConst` has to compute anew what the solver derives from masses. A target of mass 0 is
        a mark: it neither falls nor touches anything, and its body has some mass, which nothing ever feels.
        """
        shape = np.append(target.half_extents, mass).tobytes()
        if shape == self._shape:
            return False
        self._shape, model, body = shape, self._model, self._target
        geom = int(model.body_geomadr[body])
        model.geom_contype[geom], model.geom_conaffinity[geom] = self._touches if mass else (0, 0)
        model.body_gravcomp[body] = 0.0 if mass else 1.0
        self._resize(body, target.half_extents)
        x, y, z = target.half_extents**2
        # The compiler orders principal axes by size; here they stay those of the box, whatever its sides.
        model.body_iquat[body] = [1.0, 0.0, 0.0, 0.0]
        model.body_inertia[body] = (mass or 1.0) / 3 * np.array([y + z, x + z, x + y])
        model.body_mass[body] = mass or 1.0
        return True

    def _resize(self, body: int, half_extents: Array) -> None:
        """The size of a body's box and the bounding volumes that the compiler derived from it."""
        model, geom = self._model, int(self._model.body_geomadr[body])
        model.geom_size[geom] = half_extents
        model.geom_rbound[geom] = np.sqrt((half_extents**2).sum())
        model.geom_aabb[geom] = model.bvh_aabb[model.body_bvhadr[body]] = [0.0, 0.0, 0.0, *half_extents]
