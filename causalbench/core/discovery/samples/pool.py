"""Processes that collect the streams of a discovery."""

from __future__ import annotations

import pickle
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, wait
from functools import partial

from causalbench.core.discovery.samples.streams import Collector, Recipe, Stream
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.processes import Pool

PARALLEL_FROM = 5_000
"""Samples in all from which starting processes pays."""

POLL = 0.2  # s between two looks at how far the processes are


def pays(recipe: Recipe, cores: int) -> bool:
    """Whether several processes should collect: enough is asked for, and they can be told what."""
    size = recipe.task.n_stages * sum(stream.count for stream in recipe.streams(1))
    return cores > 1 and recipe.make_worlds is not None and size >= PARALLEL_FROM and _pickles(recipe)


def _pickles(recipe: Recipe) -> bool:
    try:
        pickle.dumps(recipe)
    except Exception:  # whatever a stranger's object raises when it cannot be pickled
        return False
    return True


class SamplePool:
    """All streams of all stages, queued at the first call and collected while earlier stages are decided."""

    def __init__(self, recipe: Recipe, cores: int) -> None:
        self.recipe = recipe
        self._steps, self._lock = Counter[int](), threading.Lock()
        self._pool = Pool[Stream, Samples](cores, partial(_collector, recipe), self._on_steps)
        self._queued: dict[int, list[Future[Samples]]] = {}

    def gather(self, stage: int, on_steps: Callable[[int], None]) -> list[Samples]:
        """The samples of one stage, in the order of its streams."""
        if not self._queued:
            for number in range(1, self.recipe.task.n_stages + 1):
                self._queued[number] = [self._pool.submit(stream) for stream in self.recipe.streams(number)]
        running: set[Future[Samples]] = set(self._queued[stage])
        while running:
            _, running = wait(running, POLL)
            on_steps(self._steps[stage])
        return [future.result() for future in self._queued[stage]]

    def close(self) -> None:
        """End the processes, in the middle of a stream if need be."""
        self._pool.close()

    def _on_steps(self, report: tuple[int, int]) -> None:
        stage, steps = report
        with self._lock:
            self._steps[stage] += steps


def _collector(recipe: Recipe) -> Callable[[Stream, Callable[[tuple[int, int]], None]], Samples]:
    """What a process of the pool does with a stream; it reports the stage and the env steps taken."""
    collect = Collector(recipe)
    return lambda stream, report: collect(stream, lambda steps: report((stream.stage, steps)))
