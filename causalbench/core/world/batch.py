"""Many scenes stepped as one: `BatchScene`, natively (kinematic) or as a list of ordinary scenes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import CausalbenchError

Array = NDArray[np.float64]


class BatchScene(ABC):
    """`n` worlds of one spec; as `Scene`, with a leading dimension n on actions and facts."""

    spec: SceneSpec
    n: int

    @abstractmethod
    def reset(self, index: int, layout: Layout) -> None:
        """Put world `index` into `layout`; may raise `UnreachableLayoutError`."""

    @abstractmethod
    def step(self, actions: Array) -> None:
        """Advance every world by one control step; `actions` (n, n_actions) in [-1, 1]."""

    @abstractmethod
    def facts(self) -> Facts:
        """What holds now, every field with leading dimension n."""

    def facts_of(self, indices: Sequence[int]) -> Facts:
        """What holds in some worlds, in the order of `indices`; the others need not have been reset."""
        return select(self.facts(), np.asarray(indices))

    def lidar(self) -> Array:
        """Ranges (n, 220), see `Scene.lidar`."""
        raise CausalbenchError(f"backend {self.spec.backend!r} has no capability {Capability.LIDAR!r}")

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB images (n, height, width, 3), see `Scene.render`."""
        raise CausalbenchError(f"backend {self.spec.backend!r} has no capability {Capability.RGB!r}")

    @abstractmethod
    def snapshots(self) -> list[bytes]:
        """`Scene.snapshot` of every world."""

    @abstractmethod
    def restore(self, snapshots: Sequence[bytes]) -> None:
        """Return every world to its snapshot, as `Scene.restore`."""

    @abstractmethod
    def close(self) -> None:
        """Release what the worlds hold; may be called twice."""


class SceneList(BatchScene):
    """Ordinary scenes behind the batch interface, stepped one after the other."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self.scenes, self.n, self.spec = tuple(scenes), len(scenes), scenes[0].spec

    def reset(self, index: int, layout: Layout) -> None:
        self.scenes[index].reset(layout)

    def step(self, actions: Array) -> None:
        for scene, action in zip(self.scenes, actions, strict=True):
            scene.step(action)

    def facts(self) -> Facts:
        return self.facts_of(range(self.n))

    def facts_of(self, indices: Sequence[int]) -> Facts:
        return stack([self.scenes[index].facts() for index in indices])

    def snapshots(self) -> list[bytes]:
        return [scene.snapshot() for scene in self.scenes]

    def restore(self, snapshots: Sequence[bytes]) -> None:
        for scene, snapshot in zip(self.scenes, snapshots, strict=True):
            scene.restore(snapshot)

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        return np.stack([scene.render(width, height, camera) for scene in self.scenes])

    def lidar(self) -> Array:
        return np.stack([scene.lidar() for scene in self.scenes])

    def close(self) -> None:
        for scene in self.scenes:
            scene.close()


def make_batch(make_scene: Callable[[], Scene], n: int) -> BatchScene:
    """`n` worlds: the backend's own batch where its scene offers one (`batch(n)`), else a list of scenes."""
    first = make_scene()
    if isinstance(first, Batchable):
        return first.batch(n)
    return SceneList([first, *(make_scene() for _ in range(n - 1))])


class Batchable(ABC):
    """Mixed into a scene whose backend can step many worlds at once."""

    @abstractmethod
    def batch(self, n: int) -> BatchScene:
        """`n` worlds of this scene's spec."""


_FIELDS = tuple(field.name for field in fields(Facts))


def stack(facts: Sequence[Facts]) -> Facts:
    """Facts of single worlds as one record with a leading dimension."""
    return Facts(**{name: np.stack([getattr(f, name) for f in facts]) for name in _FIELDS})


def select(facts: Facts, index: int | tuple[int, ...] | NDArray[np.int64]) -> Facts:
    """One world's facts (int) or those of several (index array)."""
    return Facts(**{name: getattr(facts, name)[index] for name in _FIELDS})
