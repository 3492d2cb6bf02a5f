"""Where cameras stand, declared once: a picture shows the same view in every simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.scene import SceneSpec
from causalbench.errors import UnknownNameError

Array = NDArray[np.float64]

FOV = 45.0  # degrees between the upper and the lower edge of every picture
WIDTH, HEIGHT = 64, 48  # pixels of the paper's image (appendix, Pure Manipulation Observation Space)
RIGHT, BACK, UP = 0.85, 0.70, 0.62  # m from the middle of what a hand works on to the camera "scene"
MIDDLE = 0.14  # m of that middle above the table


@dataclass(frozen=True)
class Camera:
    """A camera at `eye` (3,) that looks at the point `at` (3,), in m in the world, with its upper edge upwards."""

    eye: tuple[float, float, float]
    at: tuple[float, float, float]

    def axes(self) -> tuple[Array, Array, Array]:
        """Unit vectors (3,) right, up and forward in the world."""
        forward = np.subtract(self.at, self.eye)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward


def find_camera(spec: SceneSpec, name: str) -> Camera:
    """Return the camera `name` of a scene with `spec`. Raises `UnknownNameError` for a name that it does not have.

    "scene" looks over the table at hand and box of a robot that stands in the origin and faces world y, as in pure
    manipulation; "room", of robots that drive, down on the whole room.
    """
    workspace = spec.workspace
    ahead = (workspace.object_low[0] + workspace.object_high[0]) / 2
    at = (0.0, ahead, workspace.table_height + MIDDLE)
    known = {"scene": Camera((at[0] + RIGHT, at[1] + BACK, at[2] + UP), at)}
    if workspace.carry is not None:
        known["room"] = Camera((0.0, -2.5, 9.0), (0.0, -0.3, 0.0))
    if name not in known:
        raise UnknownNameError(f"camera of backend {spec.backend!r}", name, known)
    return known[name]
