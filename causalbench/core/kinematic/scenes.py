"""Kinematic worlds, standing or driving, behind the protocol: one as a scene, several as a batch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic.worlds import KinematicWorlds
from causalbench.core.world.batch import Batchable, BatchScene
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene

Array = NDArray[np.float64]


class WorldsScene(Scene, Batchable):
    """The only one of `worlds`, whose shape is ()."""

    def __init__(self, worlds: KinematicWorlds) -> None:
        self.spec, self.worlds = worlds.spec, worlds

    def batch(self, n: int) -> WorldsBatch:
        return WorldsBatch(type(self.worlds)((n,)))

    def reset(self, layout: Layout) -> None:
        self.worlds.reset((), layout)
        self.layout = layout

    def step(self, action: Array) -> None:
        self.worlds.step(action)

    def facts(self) -> Facts:
        return self.worlds.facts()

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return self.worlds.pictures(width, height, camera)

    def lidar(self) -> Array:
        return self.worlds.lidar()

    def snapshot(self) -> bytes:
        return self.worlds.snapshot(())

    def restore(self, snapshot: bytes) -> None:
        self.worlds.restore((), snapshot)
        self.layout = self.worlds.layouts[()]


class WorldsBatch(BatchScene):
    """All of `worlds`, whose shape is (n,), stepped at once."""

    def __init__(self, worlds: KinematicWorlds) -> None:
        self.spec, self.worlds, self.n = worlds.spec, worlds, worlds.shape[0]

    def reset(self, index: int, layout: Layout) -> None:
        self.worlds.reset((index,), layout)

    def step(self, actions: Array) -> None:
        self.worlds.step(actions)

    def facts(self) -> Facts:
        return self.worlds.facts()

    def layout_of(self, index: int) -> Layout | None:
        return self.worlds.layouts.get((index,))

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return self.worlds.pictures(width, height, camera)

    def lidar(self) -> Array:
        return self.worlds.lidar()

    def snapshot(self, index: int) -> bytes:
        return self.worlds.snapshot((index,))

    def restore(self, index: int, snapshot: bytes) -> None:
        self.worlds.restore((index,), snapshot)

    def close(self) -> None:
        """Nothing to release."""
