"""One cell after the other in this process: for debugging, since a crash ends everything."""

from __future__ import annotations

import functools

from causalbench.run.cell import Keeping, run_cell
from causalbench.run.executors.schedule import OnCellProgress
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell


class Serial:
    """See `schedule.Executor`."""

    def __init__(self, run: RunFolder, on_progress: OnCellProgress, keeping: Keeping) -> None:
        self.run, self.on_progress, self.keeping, self.jobs = run, on_progress, keeping, 1
        self._done: list[Cell] = []

    def free(self) -> int:
        """None until the cell before has been handed on."""
        return self.jobs - len(self._done)

    def start(self, cell: Cell) -> None:
        """Run it to its end."""
        self.run.start(cell)
        run_cell(cell, self.run, functools.partial(self.on_progress, cell), self.keeping)
        self._done.append(cell)

    def ended(self) -> list[Cell]:
        """The cell that ran."""
        done, self._done = self._done, []
        return done

    def stop(self) -> None:
        """Nothing runs beside the caller."""
