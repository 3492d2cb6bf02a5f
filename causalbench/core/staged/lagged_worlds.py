"""Scenes that execute every action one control step late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.scene_worlds import SceneWorlds, judge
from causalbench.core.staged.worlds import Step
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene
from causalbench.core.world.scene import Scene

Array = NDArray[np.float64]


class LaggedWorlds(SceneWorlds):
    """As `SceneWorlds`; what waits to be executed, nothing after a reset, is a part of every snapshot.

    A step is judged by what was executed, the last of it where an action is held for several steps.
    """

    def __init__(self, task: Task, scene: Scene | BatchScene) -> None:
        super().__init__(task, scene)
        self._waiting = np.zeros((*self.shape, len(task.actions)))

    def reset(self, worlds: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None) -> None:
        """See `Worlds`."""
        super().reset(worlds, rngs, stage)
        for world in worlds:
            self._of(world)[...] = 0.0

    def _step(self, actions: Array, repeat: int) -> Step:
        """See `Worlds`."""
        late, self._waiting = self._waiting, np.array(actions)
        before = self.facts
        step = super()._step(late, 1)
        if repeat == 1:
            return step
        super()._step(actions, repeat - 1)
        return judge(self.task, self.stage, before, actions, self.facts)

    def _of(self, world: int) -> Array:
        """What waits in one world, a view (n_actions,)."""
        return self._waiting[world] if self.shape else self._waiting

    def snapshot(self, world: int) -> bytes:
        """See `Worlds`."""
        return self._of(world).tobytes() + super().snapshot(world)

    def restore(self, worlds: Sequence[int], snapshots: Sequence[bytes]) -> None:
        """See `Worlds`."""
        size = self._waiting.itemsize * len(self.task.actions)
        for world, snapshot in zip(worlds, snapshots, strict=True):
            self._of(world)[...] = np.frombuffer(snapshot[:size])
        super().restore(worlds, [snapshot[size:] for snapshot in snapshots])
