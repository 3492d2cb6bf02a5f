"""The loop that starts cells and hands on how they ended, whatever works on them.

A learner cell that needs a discovered graph starts once that discovery is done, and is skipped if it did not succeed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from causalbench.run.cell import Progress
from causalbench.run.executors.giving_up import GivingUp
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, DiscoveryCell

Outcomes = Iterator[tuple[Cell, Status]]
OnCellProgress = Callable[[Cell, Progress], None]


class Executor(Protocol):
    """Works on cells of one run folder, several at a time, on `jobs` cores in all."""

    jobs: int

    def free(self) -> int:
        """How many of its cores have nothing to do."""

    def start(self, cell: Cell) -> None:
        """Begin to work on `cell`; its graph is there."""

    def ended(self) -> Sequence[Cell]:
        """Wait until something has happened; the cells that ended since the last call, their status written."""

    def stop(self) -> None:
        """End what still runs, each training run after a checkpoint; nothing of it goes on afterwards."""


def schedule(cells: Sequence[Cell], run: RunFolder, executor: Executor) -> Outcomes:
    """Yield each of `cells` with its status as it ends. The executor is stopped at the end, also at an early one.

    What fails alike again and again from the start is skipped, see `GivingUp`.
    """
    queue, running, giving_up = Queue(cells), 0, GivingUp(run)
    try:
        while queue.ready or running:
            while cell := queue.next(executor.free(), executor.jobs):
                if reason := _missing_graph(cell, run) or giving_up.reason(cell):
                    run.finish(cell, Status("skipped", reason))
                    queue.ended(cell)
                    yield cell, run.status(cell)
                else:
                    executor.start(cell)
                    running += 1
            for cell in executor.ended():
                running -= 1
                queue.ended(cell)
                status = run.status(cell)
                giving_up.ended(cell, status)
                yield cell, status
    finally:
        executor.stop()


class Queue:
    """The cells that have yet to start, in order; one whose discovery has yet to end is not ready."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._waiting: dict[str, list[Cell]] = {cell.id: [] for cell in cells if isinstance(cell, DiscoveryCell)}
        self.ready: list[Cell] = []
        for cell in cells:
            needed = None if isinstance(cell, DiscoveryCell) else cell.discovery
            (self._waiting.get(needed.id, self.ready) if needed else self.ready).append(cell)

    def next(self, free: int, jobs: int) -> Cell | None:
        """The first cell for which `free` cores of `jobs` are enough, taken out; None if there is none."""
        fits = (index for index, cell in enumerate(self.ready) if min(cell.cores, jobs) <= free)
        index = next(fits, None) if free > 0 else None
        return None if index is None else self.ready.pop(index)

    def ended(self, cell: Cell) -> None:
        """Make the cells ready that have waited for `cell`."""
        self.ready += self._waiting.pop(cell.id, [])


def _missing_graph(cell: Cell, run: RunFolder) -> str:
    """Why `cell` must be skipped; "" if it need not be."""
    if isinstance(cell, DiscoveryCell) or cell.discovery is None:
        return ""
    state = run.status(cell.discovery).state
    return "" if state == "done" else f"its causal discovery {cell.discovery.id} is {state}, so there is no graph"
