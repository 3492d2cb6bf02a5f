"""Many scenes stepped as one: `BatchScene`, natively (kinematic) or as a list of ordinary scenes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import NoReturn, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene, SceneSpec, lacking, not_copied
from causalbench.errors import CausalbenchError

Array = NDArray[np.float64]


class BatchScene(ABC):
    """`n` worlds of one spec that step together: a `Scene` whose actions and facts have a leading dimension n."""

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

    @abstractmethod
    def layout_of(self, index: int) -> Layout | None:
        """`Scene.layout` of world `index`."""

    def lidar(self) -> Array:
        """Ranges (n, 220), see `Scene.lidar`."""
        raise lacking(self.spec, Capability.LIDAR)

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB images (n, height, width, 3), see `Scene.render`."""
        raise lacking(self.spec, Capability.RGB)

    @abstractmethod
    def snapshot(self, index: int) -> bytes:
        """`Scene.snapshot` of world `index`."""

    @abstractmethod
    def restore(self, index: int, snapshot: bytes) -> None:
        """Return world `index` to a snapshot, as `Scene.restore`."""

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise not_copied(self.spec)

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

    def layout_of(self, index: int) -> Layout | None:
        return self.scenes[index].layout

    def snapshot(self, index: int) -> bytes:
        return self.scenes[index].snapshot()

    def restore(self, index: int, snapshot: bytes) -> None:
        self.scenes[index].restore(snapshot)

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
        try:
            return first.batch(n)
        finally:
            first.close()
    return SceneList([first, *(make_scene() for _ in range(n - 1))])


class Batchable(ABC):
    """A mixin for the scenes of a backend that can step many worlds at once."""

    @abstractmethod
    def batch(self, n: int) -> BatchScene:
        """`n` worlds of this scene's spec, which must outlive the scene: it is closed then."""


_OF_ALL = tuple(f.name for f in fields(Facts) if f.name not in ("other_positions", "other_quaternions", "extras"))
_OF_OTHERS = ("other_positions", "other_quaternions")


def stack(facts: Sequence[Facts]) -> Facts:
    """Facts of single worlds as one record with a leading dimension.

    Raises `CausalbenchError` unless all have extras of the same names and shapes.
    """
    found = {name: np.stack([getattr(f, name) for f in facts]) for name in _OF_ALL}
    if any(f.other_positions.size for f in facts):
        found |= {name: _padded([getattr(f, name) for f in facts]) for name in _OF_OTHERS}
    if any(f.extras for f in facts):
        return Facts(**found, extras=stack_extras([f.extras for f in facts]))
    return Facts(**found)


def _padded(rows: Sequence[Array]) -> Array:
    """Arrays (n_i, k) as one of (worlds, greatest n_i, k), NaN where a world has fewer rows."""
    out = np.full((len(rows), max(map(len, rows)), rows[0].shape[-1]), np.nan)
    for world, row in zip(out, rows, strict=True):
        world[: len(row)] = row
    return out


def stack_extras(extras: Sequence[Mapping[str, float | Array]]) -> dict[str, Array]:
    """Named numbers of single worlds as arrays with a leading dimension.

    Raises `CausalbenchError` unless all have the same names and shapes.
    """
    shapes = [{name: np.shape(value) for name, value in sorted(of_one.items())} for of_one in extras]
    for other in shapes[1:]:
        if other != shapes[0]:
            raise CausalbenchError(
                f"worlds of one batch have different extras, by name and shape: {shapes[0]}, {other}"
            )
    return {name: np.array([of_one[name] for of_one in extras], dtype=np.float64) for name in extras[0]}


def select(facts: Facts, index: int | tuple[int, ...] | NDArray[np.int64]) -> Facts:
    """One world's facts (int) or those of several (index array)."""
    found = {name: getattr(facts, name)[index] for name in _OF_ALL}
    if facts.other_positions.size:
        found |= {name: getattr(facts, name)[index] for name in _OF_OTHERS}
    if facts.extras:
        return Facts(**found, extras={name: value[index] for name, value in facts.extras.items()})
    return Facts(**found)
