"""Cells as tasks on a Ray cluster that is there; the run folder must lie where all nodes can write.

A task whose node dies starts again on another one, and its cell goes on from its checkpoint.
"""

from __future__ import annotations

import logging
import socket
import sys
from typing import Any

from causalbench.errors import UserError
from causalbench.run.cell import Keeping
from causalbench.run.executors.cluster_job import ClusterJob
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell

RETRIES = 5
"""How often a task starts again because its node or its worker died; an error of a cell is a result, not repeated."""


class Ray:
    """See `schedule.Executor`. `jobs` cores at a time (None: as many as the cluster has).

    `address` is that of the cluster, None for the one that Ray finds by itself, as on one of its nodes. Raises
    `UserError` where ray is missing or no cluster answers.
    """

    def __init__(self, run: RunFolder, keeping: Keeping, jobs: int | None, address: str | None) -> None:
        self.run, self.keeping, self.jobs = run, keeping, jobs or sys.maxsize
        self.ray = _connected(address or "auto")
        self._task = self.ray.remote(max_retries=RETRIES, retry_exceptions=False)(_work)
        self._running: dict[Any, Cell] = {}  # by the task's reference

    def free(self) -> int:
        """Ray has a queue of its own, which `jobs` keeps short."""
        return self.jobs - sum(cell.cores for cell in self._running.values())

    def start(self, cell: Cell) -> None:
        """Hand the cell to the cluster, with the cores that it needs."""
        self.run.start(cell)
        task = self._task.options(name=cell.id, num_cpus=cell.cores)
        self._running[task.remote(ClusterJob(cell, self.run, self.keeping))] = cell

    def ended(self) -> list[Cell]:
        """Wait for the next task that ends."""
        if not self._running:
            return []
        ready, _ = self.ray.wait(list(self._running), num_returns=1)
        cells = []
        for reference in ready:
            cell = self._running.pop(reference)
            try:
                self.ray.get(reference)
            except self.ray.exceptions.RayError as error:
                self.run.finish(cell, Status("failed", f"its Ray task ended: {str(error).splitlines()[0]}"))
            cells.append(cell)
        return cells

    def stop(self) -> None:
        """Cancel every task, which makes training runs write a checkpoint, and leave the cluster as it was."""
        for reference in self._running:
            self.ray.cancel(reference)
        if self._running:
            self.ray.wait(list(self._running), num_returns=len(self._running), timeout=60)
        self.ray.shutdown()


def _work(job: ClusterJob) -> None:
    job()


def _connected(address: str) -> Any:
    try:
        import ray
    except ImportError:
        raise UserError('--executor ray needs Ray: pip install "causalbench-robotics[ray]"') from None
    try:
        _reach(address)
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (Exception, SystemExit) as error:  # many kinds, by version
        raise UserError(f"--ray-address {address}: no Ray cluster answers there ({error})") from None
    return ray


def _reach(address: str) -> None:
    """Connect to HOST:PORT once, since Ray itself tries for minutes. Raises `OSError`."""
    host, colon, port = address.rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), timeout=10).close()
