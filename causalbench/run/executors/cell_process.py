"""A cell in a process of its own, which ends alone whatever its simulator does."""

from __future__ import annotations

import faulthandler
import os
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from types import FrameType

from causalbench.errors import StoppedError
from causalbench.processes import Child, Method, start, without_main
from causalbench.run.cell import Keeping, Progress, run_cell
from causalbench.run.cell_log import print_to, shorten
from causalbench.store.cells import LOG, Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell

STOP_SECONDS = 45.0
"""How long cells get for their checkpoints: a scheduler that stops a job waits about a minute before it kills."""

STOPPED = 75
"""Exit code of a cell's process that was asked to stop and whose cell can go on (`EX_TEMPFAIL`)."""


class StopSignal:
    """What schedulers send, as a question that a training run answers by a checkpoint; it ends at once what never asks.

    Only for a process that runs one cell and nothing else.
    """

    def __init__(self) -> None:
        self.came = self.asked = False
        for number in (signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2):
            signal.signal(number, self._on_signal)

    def __call__(self) -> bool:
        """Whether the signal has come."""
        self.asked = True
        return self.came

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.came = True
        if not self.asked:
            os._exit(STOPPED)


def start_cell(method: Method, cell: Cell, run: RunFolder, keeping: Keeping, cores: int) -> Child:
    """Work on `cell`, which `run.start` has prepared, in a new process. It reports `Progress` through its link.

    A simulator may change the working directory of that process.
    """
    with without_main():
        return start(method, _work, cell, RunFolder(run.path.absolute()), keeping, cores)


def settle(cell: Cell, child: Child, run: RunFolder, over: Status | None = None) -> None:
    """Write the status of a cell whose process has ended, if the process could not, and bound its log.

    That is `over` where the process was ended at a limit.
    """
    child.close()
    shorten(run.folder(cell) / LOG)
    if run.status(cell).state not in ("running", "pending") or child.process.exitcode == STOPPED:
        return
    run.finish(cell, over or Status("failed", f"its process {child.how_it_ended()}; see log.txt"))


def stop_all(children: Sequence[Child]) -> None:
    """End the processes, after a checkpoint where they keep one, and kill what takes over `STOP_SECONDS`."""
    deadline = time.monotonic() + STOP_SECONDS
    try:
        for child in children:
            child.terminate()
        for child in children:
            child.wait(deadline - time.monotonic())
    finally:
        for child in children:
            child.kill()


def _work(link: Connection, cell: Cell, run: RunFolder, keeping: Keeping, cores: int) -> None:
    """What a cell's process does."""
    # What a simulator prints from C, and the trace of a segfault, belong to the cell.
    print_to(run.folder(cell) / LOG)
    faulthandler.enable()
    code = 0
    try:
        run_cell(cell, run, _Throttle(link).send, keeping, cores, StopSignal())
    except StoppedError:
        code = STOPPED
    # All is on disk; what simulators do when an interpreter ends may hang or crash.
    os._exit(code)


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
