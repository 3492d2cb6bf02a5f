"""Executors: each is one generator that yields (cell, status) as cells finish.

A learner cell that needs a discovered graph starts once that discovery is done, and is skipped if it did not succeed.
"""

from __future__ import annotations

import faulthandler
import functools
import multiprocessing.connection
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from causalbench.processes import Child, preload, start
from causalbench.run.cell import Keeping, Progress, run_cell
from causalbench.run.cell_log import INTERVAL, cut, print_to, shorten
from causalbench.store.cells import LOG, Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, DiscoveryCell

Outcomes = Iterator[tuple[Cell, Status]]
OnCellProgress = Callable[[Cell, Progress], None]

PRELOAD = [
    "__main__",
    "torch",
    "causalbench.core.learners.sac.staged",
    "causalbench.core.learners.ppo.staged",
    "causalbench.core.learners.training",
    "causalbench.core.discovery.pipeline",
    "causalbench.core.discovery.reward_model.fit",
    "causalbench.run.executors",
]
"""What the fork server imports once for all cells. Never a simulator: many cannot be forked."""


def serial(cells: Sequence[Cell], run: RunFolder, on_progress: OnCellProgress, keeping: Keeping) -> Outcomes:
    """One after the other in this process: for debugging, since a crash ends everything."""
    for cell in cells:
        missing = _missing_graph(cell, run)
        if missing:
            status = Status("skipped", missing)
            run.finish(cell, status)
        else:
            run.start(cell)
            report = functools.partial(on_progress, cell)
            status = run_cell(cell, run, report, keeping)
        yield cell, status


def processes(
    cells: Sequence[Cell], run: RunFolder, on_progress: OnCellProgress, keeping: Keeping,
    jobs: int, timeout: float | None = None,
) -> Outcomes:  # fmt: skip
    """One process per cell, `jobs` cores at a time; a crash, a kill or `timeout` seconds end that cell only.

    A cell that is alone may use all of them.
    """
    preload(PRELOAD)
    queue, running = _Queue(cells), list[_Running]()
    try:
        while queue.ready or running:
            while cell := queue.next(jobs - sum(job.cores for job in running), jobs):
                if missing := _missing_graph(cell, run):
                    run.finish(cell, Status("skipped", missing))
                    yield cell, run.status(cell)
                else:
                    cores = jobs if len(cells) == 1 else min(cell.cores, jobs)
                    running.append(_start(cell, run, keeping, timeout, cores))
            _receive(running, on_progress)
            for job in [job for job in running if job.has_ended()]:
                running.remove(job)
                queue.ended(job.cell)
                yield job.cell, job.close(run)
    finally:
        for job in running:
            job.child.kill()


class _Queue:
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


@dataclass
class _Running:
    """A cell in its process."""

    cell: Cell
    child: Child
    deadline: float
    cores: int
    log: Path
    timed_out: bool = False

    def has_ended(self) -> bool:
        """Whether the process is gone; one that is past its deadline is killed first."""
        if time.monotonic() > self.deadline and self.child.is_alive():
            self.timed_out = True
            self.child.kill()
        return not self.child.is_alive()

    def close(self, run: RunFolder) -> Status:
        """Release the process and return the cell's status, recorded here if the process could not."""
        self.child.close()
        shorten(self.log)
        status = run.status(self.cell)
        if status.state in ("running", "pending"):
            status = self._died()
            run.finish(self.cell, status)
        return status

    def _died(self) -> Status:
        if self.timed_out:
            return Status("timeout", "stopped at the time limit of --timeout")
        return Status("failed", f"its process {self.child.how_it_ended()}; see log.txt")


def _start(cell: Cell, run: RunFolder, keeping: Keeping, timeout: float | None, cores: int) -> _Running:
    run.start(cell)
    child = start("forkserver", _work, cell, run, keeping, cores)
    return _Running(cell, child, time.monotonic() + (timeout or float("inf")), cores, run.folder(cell) / LOG)


def _receive(running: Sequence[_Running], on_progress: OnCellProgress) -> None:
    """Wait until a cell reports or ends, but not beyond a deadline, and hand on what was reported; bound the logs."""
    by_link = {job.child.link: job for job in running}
    wait = min(min((job.deadline for job in running), default=0.0) - time.monotonic(), INTERVAL)
    watched: list[Connection | int] = [*by_link, *(job.child.process.sentinel for job in running)]
    for ready in multiprocessing.connection.wait(watched, max(wait, 0.0)):
        if isinstance(ready, Connection):
            try:
                on_progress(by_link[ready].cell, ready.recv())
            except (EOFError, OSError):  # OSError: killed in the middle of a message
                by_link[ready].child.process.join()  # the far end closes only when the process ends
    for job in running:
        cut(job.log)


def _work(link: Connection, cell: Cell, run: RunFolder, keeping: Keeping, cores: int) -> None:
    """What a cell's process does."""
    # What a simulator prints from C, and the trace of a segfault, belong to the cell.
    print_to(run.folder(cell) / LOG)
    faulthandler.enable()
    run_cell(cell, run, _Throttle(link).send, keeping, cores)
    # All is on disk; what simulators do when an interpreter ends may hang or crash.
    os._exit(0)


class _Throttle:
    """Sends progress at most ten times a second, since reporting must not cost what it reports."""

    def __init__(self, link: Connection) -> None:
        self.link, self.next = link, 0.0

    def send(self, progress: Progress) -> None:
        """Send `progress` unless one was sent just now."""
        now = time.monotonic()
        if now >= self.next:
            self.next = now + 0.1
            self.link.send(progress)
