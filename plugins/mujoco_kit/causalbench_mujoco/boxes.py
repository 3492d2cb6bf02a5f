"""The boxes of a layout in a model: fixtures that are moved and resized, the target, which is free, and others like it.

A model is compiled with as many fixtures and others as a layout has; all else about boxes is edited in place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import Box, Layout
from causalbench_mujoco.engine import mujoco

Array = NDArray[np.float64]

TARGET = "object0"
"""Name of the target's body and of its only geom, in every model."""
OTHER = "other"
"""What the names of the bodies of the objects beside it begin with, a number follows."""
FIXTURE_COLOUR, TARGET_COLOUR, OTHER_COLOUR = (0.75, 0.7, 0.62, 1.0), (0.85, 0.2, 0.1, 1.0), (0.1, 0.4, 0.8, 1.0)
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
    _add_free(spec, TARGET, TARGET_COLOUR)


def add_others(spec: mujoco.MjSpec, count: int, **geom: Any) -> None:
    """Add `count` free boxes like the target; `geom` are further attributes of their geoms."""
    for i in range(count):
        _add_free(spec, f"{OTHER}{i}", OTHER_COLOUR, **geom)


def _add_free(spec: mujoco.MjSpec, name: str, colour: tuple[float, ...], **geom: Any) -> None:
    body = spec.worldbody.add_body(name=name, pos=[0.0, 0.0, 3.0])
    body.add_freejoint(name=name)
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02], condim=4, friction=TARGET_FRICTION,
        rgba=colour, **geom,
    )  # fmt: skip


class Boxes:
    """Those of one compiled model: `n_fixtures` fixtures, the target, whose pose in the state is the view `pose`, and
    others, whose poses are the views `other_poses`.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model, self._data = model, data
        self._fixtures = [int(body) for body in range(model.nbody) if model.body(body).name.startswith("fixture")]
        self._target = int(model.body(TARGET).id)
        geom = int(model.body_geomadr[self._target])
        self._touches = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        self._others = [int(body) for body in range(model.nbody) if model.body(body).name.startswith(OTHER)]
        self.pose, *self.other_poses = (self._pose_of(body) for body in (self._target, *self._others))
        self.n_fixtures = len(self._fixtures)
        self._shape = b""

    def _pose_of(self, body: int) -> Array:
        address = int(self._model.jnt_qposadr[self._model.body_jntadr[body]])
        return self._data.qpos[address : address + 7]

    def fits(self, layout: Layout) -> bool:
        """Whether the model was compiled with as many boxes as `layout` has."""
        return (self.n_fixtures, len(self._others)) == (len(layout.fixtures), len(layout.others))

    def put(self, layout: Layout) -> None:
        """Put the free boxes where `layout` has them."""
        for pose, box in zip((self.pose, *self.other_poses), (layout.target, *layout.others), strict=True):
            pose[:3], pose[3:] = box.position, box.quaternion

    def place(self, fixtures: tuple[Box, ...]) -> None:
        """Give the fixtures their sizes and poses; as many as the model was compiled with."""
        for body, box in zip(self._fixtures, fixtures, strict=True):
            self._model.body_pos[body], self._model.body_quat[body] = box.position, box.quaternion
            self._resize(body, box.half_extents)

    def shape(self, layout: Layout) -> bool:
        """Give the free boxes their sizes and masses, and say whether they are new.

        If they are, `mujoco.mj_setConst` has to compute anew what the solver derives from masses. A target of mass 0 is
        a mark: it neither falls nor touches anything, and its body has some mass, which nothing ever feels.
        """
        masses = layout.target_mass, *layout.other_masses
        boxes = layout.target, *layout.others
        shape = np.concatenate([*(box.half_extents for box in boxes), masses]).tobytes()
        if shape == self._shape:
            return False
        self._shape, model = shape, self._model
        geom = int(model.body_geomadr[self._target])
        model.geom_contype[geom], model.geom_conaffinity[geom] = self._touches if layout.target_mass else (0, 0)
        model.body_gravcomp[self._target] = 0.0 if layout.target_mass else 1.0
        for body, box, mass in zip((self._target, *self._others), boxes, masses, strict=True):
            self._weigh(body, box.half_extents, mass)
        return True

    def _weigh(self, body: int, half_extents: Array, mass: float) -> None:
        """The size of a free box, and the mass and inertia of a homogeneous one."""
        model = self._model
        self._resize(body, half_extents)
        x, y, z = half_extents**2
        # The compiler orders principal axes by size; here they stay those of the box, whatever its sides.
        model.body_iquat[body] = [1.0, 0.0, 0.0, 0.0]
        model.body_inertia[body] = (mass or 1.0) / 3 * np.array([y + z, x + z, x + y])
        model.body_mass[body] = mass or 1.0

    def _resize(self, body: int, half_extents: Array) -> None:
        """The size of a body's box and the bounding volumes that the compiler derived from it."""
        model, geom = self._model, int(self._model.body_geomadr[body])
        model.geom_size[geom] = half_extents
        model.geom_rbound[geom] = np.sqrt((half_extents**2).sum())
        model.geom_aabb[geom] = model.bvh_aabb[model.body_bvhadr[body]] = [0.0, 0.0, 0.0, *half_extents]
