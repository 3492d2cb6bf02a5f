"""Starts inside a stage of a Gymnasium environment, which knows no stages.

The task puts it there where it can (`GymTask.reset_into`). Elsewhere a start of the environment's own is taken if it
lies in the stage; if not, the expert, or random actions, act until the world is there, and those steps count. Where the
world can be restored, such starts are kept: a stage has `POOL` of them, each the same whenever it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.gym_world import GymWorld
from causalbench.core.tasks.gym_task import GymTask
from causalbench.errors import LayoutDrawError

MAX_DRAWS = 200
"""Starts of `GymTask.reset_into` outside the stage in a row before a reset gives up."""
MAX_ROLLOUTS = 20
"""Rollouts without the stage in a row before a reset gives up; every other one is the expert's if there is one."""
POOL = 64
"""Starts of a stage that can be returned to; what a reset draws is which."""


class GymStarts:
    """Puts worlds of `task` into stages. `on_step()` is told of every step that this takes."""

    def __init__(self, task: GymTask, on_step: Callable[[], None]) -> None:
        self.task, self.on_step = task, on_step
        self._pool: dict[tuple[int, int], bytes] = {}

    def forget(self) -> None:
        """Let go of what is kept, so that it is acted for again."""
        self._pool.clear()

    def enter(self, world: GymWorld, rng: np.random.Generator, stage: int) -> None:
        """Put `world` into a start inside `stage`, which depends on `rng` alone. Raises `LayoutDrawError`."""
        if self.task.reset_into is not None:
            self._draw(world, rng, stage)
            return
        world.reset(rng)
        if world.stage == stage:
            return
        if self.task.restore is None:
            self._roll(world, rng, stage)
            return
        key = stage, int(rng.integers(POOL))
        if key not in self._pool:
            own = np.random.default_rng(key)
            world.reset(own)
            self._roll(world, own, stage)
            self._pool[key] = world.snapshot()
        world.restore(self._pool[key])

    def _draw(self, world: GymWorld, rng: np.random.Generator, stage: int) -> None:
        for _ in range(MAX_DRAWS):
            world.reset_into(rng, stage)
            if world.stage == stage:
                return
        raise LayoutDrawError(
            f"task {self.task.name!r}: reset_into(env, rng, {stage}) led to stage {stage} in none of {MAX_DRAWS} draws"
        )

    def _roll(self, world: GymWorld, rng: np.random.Generator, stage: int) -> None:
        """Act from the start that `world` is in, and then from others, until it is in `stage`."""
        for rollout in range(MAX_ROLLOUTS):
            if rollout:
                world.reset(rng)
            by_expert = self.task.expert is not None and rollout % 2 == 0
            for _ in range(self.task.horizon):
                if world.stage == stage:
                    return
                self.on_step()
                if world.step(world.expert() if by_expert else self._random(rng), 1).terminated:
                    break
        raise LayoutDrawError(
            f"task {self.task.name!r} came into stage {stage} in none of {MAX_ROLLOUTS} rollouts of at most "
            f"{self.task.horizon} steps: give it `reset_into`, or an `expert` that gets there"
        )

    def _random(self, rng: np.random.Generator) -> NDArray[np.float64]:
        return rng.uniform(-1.0, 1.0, len(self.task.actions))
