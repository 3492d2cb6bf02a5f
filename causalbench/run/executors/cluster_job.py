"""What a job on a cluster does: work on one cell in a process of its own and write to the shared run folder."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from causalbench.processes import Child
from causalbench.run.cell import Keeping
from causalbench.run.executors.cell_process import STOPPED, settle, start_cell, stop_all
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell


@dataclass
class ClusterJob:
    """Works on `cell` when it is called, from its checkpoint if it has one. It can be pickled until then."""

    cell: Cell
    run: RunFolder
    keeping: Keeping
    child: Child | None = field(default=None, init=False)

    def __call__(self) -> None:
        """Return when the cell has ended. A process that is stopped by others is started again."""
        try:
            while True:
                self.child = start_cell("spawn", self.cell, self.run, self.keeping, self.cell.cores)
                with suppress(EOFError, OSError):  # the process has ended, or will
                    while True:
                        self.child.link.recv()
                self.child.leave()
                settle(self.cell, self.child, self.run)
                if self.child.process.exitcode != STOPPED:
                    return
        finally:
            self.stop()

    def stop(self) -> None:
        """End the cell's process, after a checkpoint where it keeps one."""
        if self.child is not None:
            stop_all([self.child])

    def checkpoint(self) -> Any:
        """What submitit calls before the time limit and where a job gives way: the job to queue again."""
        from submitit.helpers import DelayedSubmission

        self.stop()
        return DelayedSubmission(ClusterJob(self.cell, self.run, self.keeping))
