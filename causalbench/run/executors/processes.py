"""One process per cell on this machine; a crash, a kill or a limit of time or memory end that cell only."""

from __future__ import annotations

import math
import multiprocessing.connection
import time
from collections import Counter
from dataclasses import dataclass
from multiprocessing.connection import Connection

from causalbench.processes import Child, preload
from causalbench.run.cell import Keeping
from causalbench.run.cell_log import INTERVAL, cut
from causalbench.run.executors.cell_process import STOPPED, settle, start_cell, stop_all
from causalbench.run.executors.limits import Limit, Limits
from causalbench.run.executors.schedule import OnCellProgress
from causalbench.store.cells import LOG, Status
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

MEMORY_INTERVAL = 0.5  # s between two looks at the memory of cells that have a limit
RESTARTS = 5
"""How often a cell goes on from its checkpoint after others have stopped its process, as SIGTERM does."""


@dataclass
class _Job:
    """A cell in its process."""

    cell: Cell
    child: Child
    cores: int
    started: float
    heard: float
    over: Status | None = None  # of a cell that was ended at a limit

    def has_ended(self, limit: Limit, now: float) -> bool:
        """Whether the process is gone; one that is past its limit is killed first."""
        if self.child.is_alive() and (over := self._past(limit, now)):
            self.over = over
            self.child.kill()
        return not self.child.is_alive()

    def _past(self, limit: Limit, now: float) -> Status | None:
        if now > self.deadline(limit):
            return Status("timeout", limit.sentence if now > self.started + limit.seconds else limit.silent)
        if limit.memory < math.inf and (taken := self.child.resident_bytes()) > limit.memory:
            grown = f"its processes took {taken / 1e9:.2f} GB, more than --memory {limit.memory / 1e9:g} allows"
            return Status("failed", f"{grown}; see {LOG}; allow more, or ask for smaller buffers or fewer samples")
        return None

    def deadline(self, limit: Limit) -> float:
        """When it is too late for the cell."""
        return min(self.started + limit.seconds, self.heard + limit.silence)


class Processes:
    """See `schedule.Executor`. `jobs` cores at a time; a cell that is `alone` may use all of them.

    A cell may take `timeout` seconds, by default see `Limits`, and `memory` bytes.
    """

    def __init__(
        self, run: RunFolder, on_progress: OnCellProgress, keeping: Keeping, jobs: int,
        timeout: float | None = None, alone: bool = False, memory: float | None = None,
    ) -> None:  # fmt: skip
        preload(PRELOAD)
        self.run, self.on_progress, self.keeping, self.jobs = run, on_progress, keeping, jobs
        self.limits, self.alone = Limits(timeout, memory or math.inf), alone
        self.interval = INTERVAL if memory is None else MEMORY_INTERVAL
        self._running: list[_Job] = []
        self._stopped = Counter[str]()  # cell id -> how often others have stopped its process

    def free(self) -> int:
        """Cores that no cell has."""
        return self.jobs - sum(job.cores for job in self._running)

    def start(self, cell: Cell) -> None:
        """Start its process."""
        cores = self.jobs if self.alone else min(cell.cores, self.jobs)
        self.run.start(cell)
        child = start_cell("forkserver", cell, self.run, self.keeping, cores)
        now = time.monotonic()
        self._running.append(_Job(cell, child, cores, now, now))

    def ended(self) -> list[Cell]:
        """Hand on what cells report until one may have ended."""
        self._receive()
        now = time.monotonic()
        over = [job for job in self._running if job.has_ended(self.limits.of(job.cell), now)]
        for job in over:
            self._running.remove(job)
            settle(job.cell, job.child, self.run, job.over)
            if self.run.status(job.cell).state == "done":
                self.limits.took(job.cell, now - job.started)
        return [job.cell for job in over if not self._goes_on(job)]

    def _goes_on(self, job: _Job) -> bool:
        """Whether the cell was started again, since its process was stopped by others; not for ever."""
        if job.child.process.exitcode != STOPPED or self.run.status(job.cell).state != "running":
            return False
        self._stopped[job.cell.id] += 1
        if (times := self._stopped[job.cell.id]) > RESTARTS:
            self.run.finish(job.cell, Status("failed", f"others have stopped its process {times} times"))
            return False
        self.start(job.cell)
        return True

    def _receive(self) -> None:
        """Wait until a cell reports or ends, but not beyond a deadline, and hand on what was reported; bound logs."""
        by_link = {job.child.link: job for job in self._running}
        deadlines = (job.deadline(self.limits.of(job.cell)) for job in self._running)
        wait = min(min(deadlines, default=0.0) - time.monotonic(), self.interval)
        watched: list[Connection | int] = [*by_link, *(job.child.process.sentinel for job in self._running)]
        for ready in multiprocessing.connection.wait(watched, max(wait, 0.0)):
            if isinstance(ready, Connection):
                try:
                    self.on_progress(by_link[ready].cell, ready.recv())
                    by_link[ready].heard = time.monotonic()
                except (EOFError, OSError):  # OSError: killed in the middle of a message
                    by_link[ready].child.leave()
        for job in self._running:
            cut(self.run.folder(job.cell) / LOG)

    def stop(self) -> None:
        """End every process."""
        stop_all([job.child for job in self._running])
