"""One process per cell on this machine; a crash, a kill or a time limit end that cell only."""

from __future__ import annotations

import multiprocessing.connection
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

from causalbench.processes import Child, preload
from causalbench.run.cell import Keeping
from causalbench.run.cell_log import INTERVAL, cut
from causalbench.run.executors.cell_process import settle, start_cell, stop_all
from causalbench.run.executors.schedule import OnCellProgress
from causalbench.store.cells import LOG
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell

PRELOAD = [
    "torch",
    "causalbench.core.learners.sac.staged",
    "causalbench.core.learners.ppo.staged",
    "causalbench.core.learners.training",
    "causalbench.core.discovery.pipeline",
    "causalbench.core.discovery.reward_model.fit",
    "causalbench.run.executors.cell_process",
]
"""What the fork server imports once for all cells. Never a simulator: many cannot be forked."""


@dataclass
class _Job:
    """A cell in its process."""

    cell: Cell
    child: Child
    deadline: float
    cores: int
    timed_out: bool = False

    def has_ended(self) -> bool:
        """Whether the process is gone; one that is past its deadline is killed first."""
        if time.monotonic() > self.deadline and self.child.is_alive():
            self.timed_out = True
            self.child.kill()
        return not self.child.is_alive()


class Processes:
    """See `schedule.Executor`. `jobs` cores at a time; a cell may take `timeout` seconds.

    A cell that is `alone` may use all of them.
    """

    def __init__(
        self, run: RunFolder, on_progress: OnCellProgress, keeping: Keeping, jobs: int,
        timeout: float | None = None, alone: bool = False,
    ) -> None:  # fmt: skip
        preload(PRELOAD)
        self.run, self.on_progress, self.keeping, self.jobs = run, on_progress, keeping, jobs
        self.timeout, self.alone = timeout or float("inf"), alone
        self._running: list[_Job] = []

    def free(self) -> int:
        """Cores that no cell has."""
        return self.jobs - sum(job.cores for job in self._running)

    def start(self, cell: Cell) -> None:
        """Start its process."""
        cores = self.jobs if self.alone else min(cell.cores, self.jobs)
        self.run.start(cell)
        child = start_cell("forkserver", cell, self.run, self.keeping, cores)
        self._running.append(_Job(cell, child, time.monotonic() + self.timeout, cores))

    def ended(self) -> list[Cell]:
        """Hand on what cells report until one may have ended."""
        self._receive()
        over = [job for job in self._running if job.has_ended()]
        for job in over:
            self._running.remove(job)
            settle(job.cell, job.child, self.run, job.timed_out)
        return [job.cell for job in over]

    def _receive(self) -> None:
        """Wait until a cell reports or ends, but not beyond a deadline, and hand on what was reported; bound logs."""
        by_link = {job.child.link: job for job in self._running}
        wait = min(min((job.deadline for job in self._running), default=0.0) - time.monotonic(), INTERVAL)
        watched: list[Connection | int] = [*by_link, *(job.child.process.sentinel for job in self._running)]
        for ready in multiprocessing.connection.wait(watched, max(wait, 0.0)):
            if isinstance(ready, Connection):
                try:
                    self.on_progress(by_link[ready].cell, ready.recv())
                except (EOFError, OSError):  # OSError: killed in the middle of a message
                    by_link[ready].child.process.join()  # the far end closes only when the process ends
        for job in self._running:
            cut(self.run.folder(job.cell) / LOG)

    def stop(self) -> None:
        """End every process."""
        stop_all([job.child for job in self._running])
