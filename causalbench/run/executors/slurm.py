"""Cells as jobs of Slurm arrays, by submitit; the run folder must lie where all nodes can write.

Jobs outlive a command that dies; the same command finds them again. Before its time limit a job writes a checkpoint and
queues itself again.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from causalbench.atomic import write_text
from causalbench.errors import UserError
from causalbench.run.cell import Keeping
from causalbench.run.executors.cluster_job import ClusterJob
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell

FOLDER, JOBS = ".slurm", "jobs.json"
POLL_SECONDS = 2.0
ENDED = ("done", "diverged", "failed", "skipped", "timeout")


class Slurm:
    """See `schedule.Executor`. `jobs` jobs of an array at a time (None: as many as Slurm allows).

    `options` are submitit's for Slurm, such as `{"time": 240, "partition": "cpu"}`. `cluster` is submitit's name
    of what runs the jobs. Raises `UserError` where submitit or Slurm is missing or an option is not known.
    """

    def __init__(
        self, run: RunFolder, keeping: Keeping, jobs: int | None, options: Mapping[str, Any], cluster: str = "slurm"
    ) -> None:
        self.run, self.keeping, self.jobs = run, keeping, sys.maxsize
        self.folder = run.path / FOLDER
        self.executor = _executor(self.folder, cluster)
        parallel = {} if jobs is None else {"array_parallelism": jobs}
        _set(self.executor, parallel | dict(options))
        self._known = _job_ids(self.folder / JOBS)  # cell id -> id of the last job that was submitted for it
        self._new: list[Cell] = []
        self._running: dict[str, tuple[Cell, Any]] = {}  # cell id -> cell and its submitit job

    def free(self) -> int:
        """All: Slurm has a queue of its own."""
        return self.jobs

    def start(self, cell: Cell) -> None:
        """Queue a job, unless one of an earlier command is still at work on the cell."""
        job = self._job_of_an_earlier_command(cell)
        if job is None:
            self.run.start(cell)
            self._new.append(cell)
        else:
            self._running[cell.id] = (cell, job)

    def ended(self) -> list[Cell]:
        """Submit what is new as one array a number of cores, then look every two seconds."""
        self._submit()
        while self._running:
            over = [cell for cell, job in self._running.values() if self._is_over(cell, job)]
            if over:
                for cell in over:
                    del self._running[cell.id]
                return over
            time.sleep(POLL_SECONDS)
        return []

    def stop(self) -> None:
        """Cancel every job; Slurm's SIGTERM makes training runs write a checkpoint."""
        for _, job in self._running.values():
            job.cancel()

    def _submit(self) -> None:
        for cores in sorted({cell.cores for cell in self._new}):
            cells = [cell for cell in self._new if cell.cores == cores]
            self.executor.update_parameters(cpus_per_task=cores)
            jobs = _submitted(self.executor, [ClusterJob(cell, self.run, self.keeping) for cell in cells])
            self._running |= {cell.id: (cell, job) for cell, job in zip(cells, jobs, strict=True)}
        if self._new:
            self._new = []
            self._known |= {name: job.job_id for name, (_, job) in self._running.items()}
            write_text(self.folder / JOBS, json.dumps(self._known, indent=1) + "\n")

    def _job_of_an_earlier_command(self, cell: Cell) -> Any:
        known = self._known.get(cell.id)
        if known is None or self.run.status(cell).state != "running":
            return None
        job = self.executor.job_class(self.folder, known)
        return None if job.done(force_check=True) else job

    def _is_over(self, cell: Cell, job: Any) -> bool:
        """Whether the cell has ended, its status written here if its job could not."""
        if self.run.status(cell).state in ENDED:
            return True
        if not job.done():
            return False
        if self.run.status(cell).state not in ENDED:
            reason = f"its job {job.job_id} ended as {job.state}; see {job.paths.stderr}"
            self.run.finish(cell, Status("failed", reason))
        return True


def _job_ids(path: Path) -> dict[str, str]:
    try:
        known: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):  # none was, or the file is damaged: then cells may run twice, to the same bytes
        return {}
    return known


def _executor(folder: Path, cluster: str) -> Any:
    try:
        import submitit
    except ImportError:
        raise UserError('--executor slurm needs submitit: pip install "causalbench-robotics[slurm]"') from None
    if cluster == "slurm" and shutil.which("sbatch") is None:
        raise UserError("--executor slurm needs Slurm: there is no `sbatch` on the path of this machine")
    return submitit.AutoExecutor(folder, cluster=cluster)


def _submitted(executor: Any, work: Sequence[ClusterJob]) -> list[Any]:
    """One array of jobs. Raises `UserError` with what Slurm says where it refuses them."""
    from submitit.core.utils import FailedJobError

    try:
        with executor.batch():
            return [executor.submit(one) for one in work]
    except FailedJobError as error:
        raise UserError(f"Slurm refuses the jobs: {str(error).strip()}; change --slurm NAME=VALUE") from None


def _set(executor: Any, parameters: Mapping[str, Any]) -> None:
    """Set submitit's parameters for Slurm. Raises `UserError` for one that it does not know."""
    for name, value in parameters.items():
        try:
            executor.update_parameters(**{f"slurm_{name}": value})
        except (NameError, TypeError, ValueError) as error:
            raise UserError(f"--slurm {name}={value}: {error}") from None
