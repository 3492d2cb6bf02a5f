"""The sets of samples that a discovery needs, and the recipe by which any process collects one of them.

Each set is a stream of random numbers of its own, so that its samples depend neither on the number of processes nor on
what was collected before it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from causalbench.core.discovery.registry import SAMPLE_SETS, SampleSet
from causalbench.core.discovery.samples.collect import collect
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.staged.worlds import MakeWorlds, Origin, Worlds
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.tasks.task_data import task_data
from causalbench.digests import content_hash
from causalbench.errors import UndecidedStageError

N_WORLDS = 16
"""Worlds of a backend that steps in batches; sequences have a fixed length, so the number changes no distribution."""

About = Mapping[str, Any]
"""What determines the samples of one set, as JSON data: task, backend, stage, set, seed, count, ..."""


class SampleStore(Protocol):
    """Where samples are kept. Used in several processes at a time, so it must pickle."""

    def load(self, about: About) -> Samples | None:
        """The samples that were kept with an equal `about`; None if there are none or they are damaged."""

    def save(self, about: About, samples: Samples, task: StageTask) -> None:
        """Keep `samples`, as a whole or not at all."""


@dataclass(frozen=True)
class Stream:
    """One set of samples: what its generator is seeded with beside seed and stage, its size, the action held at 0."""

    stage: int
    name: str
    number: int
    count: int
    do: int | None


def streams(
    task: StageTask, settings: DiscoverySettings, stage: int, reads: frozenset[SampleSet] = SAMPLE_SETS
) -> list[Stream]:
    """D_random, D_inference, D_do of every action and, with placebos, one more random set that stands for theirs.

    Only what `reads` names of them.
    """
    count, sets = settings.training_count, list[Stream]()
    if "random" in reads:
        sets.append(Stream(stage, "random", 0, count, None))
    if "inference" in reads:
        sets.append(Stream(stage, "inference", 1, round(settings.inference_fraction * count), None))
    if "do" in reads:
        sets += [Stream(stage, f"do-{action}", 2 + k, count, k) for k, action in enumerate(task.actions)]
        if settings.n_placebos:
            sets.append(Stream(stage, "placebo", 2 + len(task.actions), count, None))
    return sets


@dataclass(frozen=True)
class Recipe:
    """All that a process needs to collect any stream of one discovery."""

    task: StageTask
    settings: DiscoverySettings
    seed: int
    origin: Origin
    make_worlds: MakeWorlds | None
    store: SampleStore | None
    reads: frozenset[SampleSet] = SAMPLE_SETS

    def streams(self, stage: int) -> list[Stream]:
        """The sets that are wanted of `stage`."""
        return streams(self.task, self.settings, stage, self.reads)

    def about(self, stream: Stream) -> About:
        """What determines the samples of `stream`."""
        return {
            "task": self.task.name,
            "task_version": self.task.version,
            "task_data": content_hash(task_data(self.task)),
            "backend": self.origin.backend,
            "engine": self.origin.engine,
            "robot": self.origin.robot,
            "stage": stream.stage,
            "set": stream.name,
            "seed": self.seed,
            "count": stream.count,
            "sequence_length": self.settings.sequence_length,
            "n_placebos": self.settings.n_placebos,
            "inference_fraction": self.settings.inference_fraction,
            "worlds": N_WORLDS,
            **({"intervene": "step"} if self.settings.intervene == "step" and stream.do is not None else {}),
            **({"features": True} if self.settings.features and self.task.features else {}),
            **({"observation": seen} if (seen := self.settings.observation) != "state" else {}),
            **({"action_repeat": self.settings.action_repeat} if self.settings.action_repeat > 1 else {}),
        }

    def prepared(self, worlds: Worlds) -> Worlds:
        """`worlds`, whose `states` from now on are what the settings say."""
        worlds.choose_observation(observe=self.settings.observation, features=self.settings.features)
        return worlds

    def kept(self, stream: Stream) -> Samples | None:
        """The samples of `stream` if the store has them."""
        return self.store.load(self.about(stream)) if self.store else None

    def collect(self, stream: Stream, worlds: Worlds, on_step: Callable[[int], None]) -> Samples:
        """Collect `stream` and keep it."""
        worlds.forget_starts()
        rng = np.random.default_rng([self.seed, stream.stage, stream.number])
        length, placebos = self.settings.sequence_length, self.settings.n_placebos
        sensor = self.task.sensor_in(self.settings.observation)
        samples = collect(
            worlds, stream.stage, stream.count, stream.do, rng, length, placebos, on_step, sensor,
            self.settings.action_repeat, self.settings.intervene == "step",
        )  # fmt: skip
        if self.store:
            self.store.save(self.about(stream), samples, self.task)
        return samples


class Collector:
    """Collects one stream after the other in worlds that it makes at the first one which is not kept already."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self._worlds: Worlds | None = None

    def __call__(self, stream: Stream, on_step: Callable[[int], None]) -> Samples:
        """The samples of `stream`; `on_step(n)` is told of every n env steps that they took."""
        kept = self.recipe.kept(stream)
        if kept is not None:
            on_step(kept.env_steps)
            return kept
        if self._worlds is None:
            if self.recipe.make_worlds is None:
                raise UndecidedStageError("a file with samples is missing, and there is no simulator to collect them")
            self._worlds = self.recipe.prepared(self.recipe.make_worlds(N_WORLDS))
        return self.recipe.collect(stream, self._worlds, on_step)

    def close(self) -> None:
        """Release the worlds."""
        if self._worlds:
            self._worlds.close()
