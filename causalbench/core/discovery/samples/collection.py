"""All streams of random and intervention data that a discovery needs, in this process or several, kept if asked to.

Each stream has a generator of its own, so that its samples depend neither on the number of processes nor on what was
collected before it.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import pickle
import signal
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing.sharedctypes import SynchronizedArray
from multiprocessing.synchronize import Event
from typing import Any, Protocol

import numpy as np

from causalbench.core.discovery.registry import SAMPLE_SETS, SampleSet
from causalbench.core.discovery.samples.collect import collect
from causalbench.core.discovery.samples.transitions import Samples, StageSamples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene, make_batch
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import LayoutDrawError, UndecidedStageError

N_WORLDS = 16
"""Worlds of a backend that steps in batches; sequences have a fixed length, so the number changes no distribution."""

LEAST_SHARE = 0.5
"""A stage in which some set has less than this share of the samples that were asked for is not decided."""

PARALLEL_FROM = 5_000
"""Samples in all from which starting processes pays."""

POLL = 0.2  # s between two looks at how far the processes are

About = Mapping[str, Any]
"""What determines the samples of one set, as JSON data: task, backend, stage, set, seed, count, ..."""


class SampleStore(Protocol):
    """Where samples are kept. Used in several processes at a time, so it must pickle."""

    def load(self, about: About) -> Samples | None:
        """The samples that were kept with an equal `about`; None if there are none or they are damaged."""

    def save(self, about: About, samples: Samples, task: Task) -> None:
        """Keep `samples`, as a whole or not at all."""


@dataclass(frozen=True)
class Origin:
    """Which simulator the samples are from."""

    backend: str
    engine: str
    robot: str

    @classmethod
    def of(cls, spec: SceneSpec) -> Origin:
        """That of scenes with `spec`."""
        return cls(f"{spec.backend} {spec.backend_version}", f"{spec.engine} {spec.engine_version}", spec.robot)


@dataclass(frozen=True)
class Stream:
    """One set of samples: what its generator is seeded with beside seed and stage, its size, the action held at 0."""

    stage: int
    name: str
    number: int
    count: int
    do: int | None


def streams(
    task: Task, settings: DiscoverySettings, stage: int, reads: frozenset[SampleSet] = SAMPLE_SETS
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

    task: Task
    settings: DiscoverySettings
    seed: int
    origin: Origin
    make_scene: Callable[[], Scene] | None
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
            **({"observation": "paper"} if self.settings.observation == "paper" else {}),
            **({"action_repeat": self.settings.action_repeat} if self.settings.action_repeat > 1 else {}),
        }

    def kept(self, stream: Stream) -> Samples | None:
        """The samples of `stream` if the store has them."""
        return self.store.load(self.about(stream)) if self.store else None

    def collect(self, stream: Stream, batch: BatchScene, on_step: Callable[[int], None]) -> Samples:
        """Collect `stream` and keep it."""
        rng = np.random.default_rng([self.seed, stream.stage, stream.number])
        length, placebos = self.settings.sequence_length, self.settings.n_placebos
        sensor = self.task.sensor_in(self.settings.observation)
        samples = collect(
            self.task, batch, stream.stage, stream.count, stream.do, rng, length, placebos, on_step, sensor,
            self.settings.action_repeat,
        )  # fmt: skip
        if self.store:
            self.store.save(self.about(stream), samples, self.task)
        return samples


class Collection:
    """The samples of all stages, each collected when first asked for; with several `cores` all stages at once.

    `on_share(stage, share)` is told how far a stage is; `env_steps` counts those of the stages that were asked for.
    A small collection, or a task or scene factory that cannot be pickled, is stepped in this process alone.
    """

    def __init__(self, recipe: Recipe, cores: int, on_share: Callable[[int, float], None]) -> None:
        self.recipe, self.on_share = recipe, on_share
        self.env_steps: dict[int, int] = {}
        self._batch: BatchScene | None = None
        several = cores > 1 and recipe.make_scene is not None and _size(recipe) >= PARALLEL_FROM and _pickles(recipe)
        self._pool = _Pool(recipe, cores) if several else None

    def stage(self, stage: int) -> StageSamples:
        """The samples of one stage. Raises `LayoutDrawError` or `UndecidedStageError`."""
        wanted = self.recipe.streams(stage)
        planned = sum(stream.count for stream in wanted) * self.recipe.settings.action_repeat

        def on_steps(steps: int) -> None:
            self.env_steps[stage] = steps
            self.on_share(stage, min(1.0, steps / planned))

        return self._assemble(
            wanted, self._pool.gather(stage, on_steps) if self._pool else self._gather(wanted, on_steps)
        )

    def close(self) -> None:
        """Stop collecting and release the scenes."""
        if self._pool:
            self._pool.close()
        if self._batch:
            self._batch.close()

    def _gather(self, wanted: list[Stream], on_steps: Callable[[int], None]) -> list[Samples]:
        steps, found, errors = 0, list[Samples](), list[LayoutDrawError]()

        def on_step(n: int) -> None:
            nonlocal steps
            steps += n
            on_steps(steps)

        for stream in wanted:
            try:
                samples = self.recipe.kept(stream)
                if samples is None:
                    samples = self.recipe.collect(stream, self._worlds(), on_step)
                else:
                    on_step(samples.env_steps)
                found.append(samples)
            except LayoutDrawError as error:  # the rest is collected, as it would be by several processes
                errors.append(error)
        if errors:
            raise errors[0]
        return found

    def _worlds(self) -> BatchScene:
        if self._batch is None:
            if self.recipe.make_scene is None:
                raise UndecidedStageError("a file with samples is missing, and there is no simulator to collect them")
            self._batch = make_batch(self.recipe.make_scene, N_WORLDS)
        return self._batch

    def _assemble(self, wanted: list[Stream], found: list[Samples]) -> StageSamples:
        notes = []
        for stream, samples in zip(wanted, found, strict=True):
            if len(samples) < stream.count:
                note = (
                    f"{len(samples)} of {stream.count} samples in {stream.name!r}: "
                    f"{samples.refused} of {samples.env_steps} steps were not finite"
                )
                if len(samples) < max(2, LEAST_SHARE * stream.count):
                    raise UndecidedStageError(note)
                notes.append(note)
        named = {stream.name: samples for stream, samples in zip(wanted, found, strict=True)}
        empty = found[0].first(0)
        random, inference = named.pop("random", empty), named.pop("inference", empty)
        shortest = min(map(len, named.values()), default=0)
        extra, *interventions = [named.pop("placebo", None), *named.values()]
        if self.recipe.settings.sequence_length > 1 and 0 < len(random) == len(np.unique(random.sequence)):
            notes.append("every random step left the stage, so that each sample is a first step")
        return StageSamples(
            random,
            inference,
            tuple(samples.first(shortest) for samples in interventions),
            extra and extra.first(shortest),
            tuple(notes),
        )


def _size(recipe: Recipe) -> int:
    return recipe.task.n_stages * sum(stream.count for stream in recipe.streams(1))


def _pickles(recipe: Recipe) -> bool:
    try:
        pickle.dumps(recipe)
    except Exception:  # whatever a stranger's object raises when it cannot be pickled
        return False
    return True


class _Pool:
    """Processes that collect streams; all streams of all stages are queued at the first call."""

    def __init__(self, recipe: Recipe, cores: int) -> None:
        # Spawned, so that they share this process's standard output: what a simulator prints belongs with the rest.
        context = multiprocessing.get_context("spawn")
        self.recipe = recipe
        self.stop = context.Event()
        self.steps = context.Array("q", recipe.task.n_stages + 1)
        self.executor = ProcessPoolExecutor(cores, context, _start_worker, (recipe, self.stop, self.steps))
        self.queued: dict[int, list[Future[Samples]]] = {}

    def gather(self, stage: int, on_steps: Callable[[int], None]) -> list[Samples]:
        """The samples of one stage, in the order of `streams`."""
        if not self.queued:
            for number in range(1, self.recipe.task.n_stages + 1):
                self.queued[number] = [self.executor.submit(_collect, s) for s in self.recipe.streams(number)]
        running: set[Future[Samples]] = set(self.queued[stage])
        while running:
            _, running = wait(running, POLL)
            on_steps(self.steps[stage])
        return [future.result() for future in self.queued[stage]]

    def close(self) -> None:
        """End the processes, in the middle of a stream if need be."""
        self.stop.set()
        self.executor.shutdown(cancel_futures=True)


class _Worker:
    """What a process of the pool keeps between streams."""

    def __init__(self, recipe: Recipe, stop: Event, steps: SynchronizedArray[int]) -> None:
        self.recipe, self.stop, self.steps = recipe, stop, steps
        self.batch: BatchScene | None = None

    def collect(self, stream: Stream) -> Samples:
        def on_step(n: int) -> None:
            if self.stop.is_set():
                raise InterruptedError("stopped")
            with self.steps.get_lock():
                self.steps[stream.stage] += n

        kept = self.recipe.kept(stream)
        if kept is not None:
            on_step(kept.env_steps)
            return kept
        if self.batch is None:
            assert self.recipe.make_scene is not None
            self.batch = make_batch(self.recipe.make_scene, N_WORLDS)
        return self.recipe.collect(stream, self.batch, on_step)


_worker: _Worker


def _start_worker(recipe: Recipe, stop: Event, steps: SynchronizedArray[int]) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which then stops its workers
    threading.Thread(target=_die_with_parent, daemon=True).start()
    _worker = _Worker(recipe, stop, steps)


def _die_with_parent() -> None:
    """A parent that is killed cannot stop its workers."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)


def _collect(stream: Stream) -> Samples:
    return _worker.collect(stream)
