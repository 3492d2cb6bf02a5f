"""What the checks of a task work with: its worlds in one backend, and walks through every stage that were recorded."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.worlds import Step, Worlds
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability
from causalbench.errors import LayoutDrawError
from causalbench.plugins.backends import NO_OPTIONS, Backend
from causalbench.plugins.venues import worlds_maker

Array = NDArray[np.float64]

STARTS, RANDOM, SCRIPTED = 3, 15, 15
"""Of each stage so many starts are walked from: first at random, then as the expert does."""


class Sample(NamedTuple):
    """One step: what was seen before and after it (`Facts` or `Seen`), what was executed, and what it meant."""

    before: Any
    action: Array
    step: Step
    now: Any


class TaskBench:
    """Worlds of one task in one backend, closed at the end.

    `worlds` is one world that all checks share, each of which resets it; `walks` are the samples that most of them
    read. Raises `UserError` where the backend cannot run the task.
    """

    known_gaps: Mapping[str, str] = {}

    def __init__(self, task: StageTask, backend: Backend, options: Mapping[str, Any] = NO_OPTIONS) -> None:
        self.task: Any = task  # a Task or a GymTask: their functions take Facts or Seen, and mean the same
        self.make_worlds = worlds_maker(backend, task, options)
        self._made: list[Worlds] = []

    def make(self, n: int | None = None) -> Worlds:
        """New worlds."""
        self._made.append(self.make_worlds(n))
        return self._made[-1]

    @functools.cached_property
    def worlds(self) -> Worlds:
        """The one world that all checks share."""
        return self.make()

    @property
    def offers(self) -> frozenset[str]:
        """Capabilities of the worlds, and which optional parts the task has."""
        parts = ("features", "potential", "after_success", "modules", "env_id")
        return self.worlds.capabilities | {name for name in parts if getattr(self.task, name, None)}

    @property
    def stages(self) -> range:
        """The stages of the task."""
        return range(1, self.task.n_stages + 1)

    def seen(self) -> Any:
        """What the task's functions read of the shared world now."""
        return seen(self.worlds)

    @functools.cached_property
    def refused(self) -> dict[int, str]:
        """Stage -> why no start in it was found; those of the stages that can be entered are `starts`."""
        return {stage: reason for stage, (_, reason) in self._entered.items() if reason}

    @functools.cached_property
    def starts(self) -> dict[int, list[Any]]:
        """Stage -> what is seen at `STARTS` starts in it, the i-th drawn from the seed i."""
        return {stage: found for stage, (found, _) in self._entered.items() if found}

    @functools.cached_property
    def _entered(self) -> dict[int, tuple[list[Any], str]]:
        return {stage: self._enter(stage) for stage in self.stages}

    def _enter(self, stage: int) -> tuple[list[Any], str]:
        found: list[Any] = []
        for seed in range(STARTS):
            try:
                self.worlds.reset([0], [np.random.default_rng(seed)], stage)
            except LayoutDrawError as error:
                return found, str(error)
            found.append(self.seen())
        return found, ""

    @functools.cached_property
    def samples(self) -> list[Sample]:
        """Every step of the walks from the starts of every stage that can be entered."""
        return [sample for stage in self.starts for seed in range(STARTS) for sample in self.walk(stage, seed)]

    def walk(self, stage: int, seed: int, worlds: Worlds | None = None) -> list[Sample]:
        """Steps from a start of `stage`, at random and then as the expert does, until the world cannot go on."""
        worlds = worlds or self.worlds
        rng = np.random.default_rng(seed)
        worlds.reset([0], [rng], stage)
        scripted = SCRIPTED if Capability.EXPERT in worlds.capabilities else 0
        found: list[Sample] = []
        for count in range(RANDOM + scripted):
            wanted = rng.uniform(-1.0, 1.0, len(self.task.actions)) if count < RANDOM else expert(worlds)
            found.append(take(worlds, wanted))
            if found[-1].step.terminated:
                break
        return found

    def close(self) -> None:
        """Close all worlds made here."""
        for worlds in self._made:
            worlds.close()


def seen(worlds: Worlds) -> Any:
    """What the functions of a task read of one world now: `Facts` of a scene, `Seen` of an environment."""
    from causalbench.core.staged.gym_worlds import GymWorlds

    return worlds.worlds[0].seen if isinstance(worlds, GymWorlds) else worlds.facts  # type: ignore[attr-defined]


def take(worlds: Worlds, wanted: Array) -> Sample:
    """One step of one world, the rewards being copied: what a task returns may be its own."""
    before, step = seen(worlds), worlds.step(wanted)
    step = step._replace(rewards=np.array(step.rewards))
    return Sample(before, worlds.task.executed(wanted), step, seen(worlds))


def expert(worlds: Worlds) -> Array:
    """The expert's action (n_actions,) in one world, brought into the bounds."""
    return np.clip(np.nan_to_num(worlds.expert()), -1.0, 1.0)
