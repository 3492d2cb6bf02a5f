"""One `causalbench run`: what is still to do in a run folder, and doing it."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from causalbench.atomic import write_text
from causalbench.errors import StorageError, UserError
from causalbench.plugins.manager import Plugins
from causalbench.processes import cores
from causalbench.run.amending import amend
from causalbench.run.cell import Keeping
from causalbench.run.executors.processes import Processes
from causalbench.run.executors.ray import Ray
from causalbench.run.executors.schedule import Executor, Outcomes, schedule
from causalbench.run.executors.serial import Serial
from causalbench.run.executors.slurm import Slurm
from causalbench.run.view import View
from causalbench.store.budgets import is_outgrown, largest_budgets
from causalbench.store.cells import State, Status
from causalbench.store.comparable import check_comparable
from causalbench.store.run_folder import SUITE, RunFolder
from causalbench.suite.cells import Cell, LearnerCell
from causalbench.suite.plan import Plan
from causalbench.suite.schema import SuiteFile

FINAL: frozenset[State] = frozenset({"done", "diverged", "timeout"})
"""States that a second command leaves alone: a diverged cell would diverge again, a timeout was the user's limit."""

PACKAGES = ("causalbench-robotics", "gymnasium", "numpy", "torch", "stable-baselines3")


@dataclass(frozen=True)
class Execution:
    """How to run: executor, cells at a time (None: what there is room for), what to repeat and to keep.

    Also the seconds and the bytes of memory that a cell may take (None: no limit), and where a cluster is.
    """

    executor: str
    jobs: int | None
    timeout: float | None
    retry: bool
    keeping: Keeping
    ray_address: str | None = None
    slurm: Mapping[str, Any] = field(default_factory=dict)
    memory: float | None = None

    def outcomes(self, cells: Sequence[Cell], run: RunFolder, view: View) -> Outcomes:
        """Start the executor. Raises `UserError` for what it cannot do: a limit to keep, options of another one."""
        for flag, value, executor in (
            ("--timeout", self.timeout, "processes"), ("--memory", self.memory, "processes"),
            ("--ray-address", self.ray_address, "ray"), ("--slurm", self.slurm or None, "slurm"),
        ):  # fmt: skip
            if value is not None and self.executor != executor:
                raise UserError(f"{flag} needs --executor {executor}, this run has {self.executor}: change one of them")
        if self.memory is not None and not sys.platform.startswith("linux"):
            raise UserError("--memory reads /proc, which this machine does not have; leave it out")
        return schedule(cells, run, self._executor(len(cells) == 1, run, view))

    def _executor(self, alone: bool, run: RunFolder, view: View) -> Executor:
        if self.executor == "processes":
            jobs = self.jobs or cores()
            return Processes(run, view.on_progress, self.keeping, jobs, self.timeout, alone, self.memory)
        if self.executor == "ray":
            return Ray(run, self.keeping, self.jobs, self.ray_address)
        if self.executor == "slurm":
            return Slurm(run, self.keeping, self.jobs, self.slurm)
        return Serial(run, view.on_progress, self.keeping)


def run_plan(
    plan: Plan, run: RunFolder, file: SuiteFile, plugins: Plugins, execution: Execution, view: View,
    after: Callable[[], object],
) -> None:  # fmt: skip
    """Run what `plan` lacks in `run`, calling `after` at the end, even an interrupted one, while the folder is claimed.

    Raises `RunFolderError` when the folder cannot be used or holds cells that cannot be compared with these, and
    `StorageError` when it cannot be written any more: a full disk, a folder that was removed.
    """
    with run.claim(), _storage_named(run):
        _check(plan, run)
        write_text(run.path / SUITE, file.source.text)
        if file.suite.methods:
            run.state(plan.statement)
        _skip(plan, run)
        cells = to_do(plan, run, execution.retry)
        if cells:
            session = describe_environment(plugins, sorted({cell.backend.name for cell in plan.cells}))
            run.add_session(session | {"cells": len(plan.cells)})
        for sentence in amend(cells, run):
            view.note(sentence)
        started = execution.outcomes(cells, run, view)
        try:
            view.begin(plan.cells, cells, run)
            with closing(started) as outcomes:  # type: ignore[type-var]
                for cell, status in outcomes:
                    view.on_outcome(cell, status)
        finally:
            view.end()
            after()


@contextmanager
def _storage_named(run: RunFolder) -> Iterator[None]:
    """Errors of the file system as a `StorageError` that says what is lost and how to go on."""
    try:
        yield
    except OSError as error:
        if not run.path.is_dir():
            raise StorageError(
                f"{run.path}: the folder was removed while its cells were running; the same command starts over"
            ) from error
        raise StorageError(
            f"{error.filename or run.path}: {error.strerror or error}; finished cells are kept, "
            "and once that is mended the same command goes on"
        ) from error


def _check(plan: Plan, run: RunFolder) -> None:
    """Raise `RunFolderError` where `run` holds what cannot be compared with `plan` for more than a smaller budget."""
    largest = largest_budgets(cell.identity for cell in plan.cells)
    stored = [(str(cell.folder), cell.identity) for cell in run.cells()]
    there = [
        (where, {**found, "env_steps": largest[found["backend"]["name"]]} if is_outgrown(found, largest) else found)
        for where, found in stored
    ]
    check_comparable([*there, *((f"this plan ({cell.id})", cell.identity) for cell in plan.cells)])


def to_do(plan: Plan, run: RunFolder, retry: bool) -> list[Cell]:
    """The cells that are missing or failed and can be run; with `retry` also the diverged and timed-out ones."""
    keep = {"done"} if retry else FINAL
    possible = (cell for cell in plan.cells if cell.id not in plan.impossible)
    return [cell for cell in possible if run.status(cell).state not in keep]


def status_in(plan: Plan, run: RunFolder, cell: Cell) -> Status:
    """How a cell of `plan` stands in `run`; skipped, too, before a run has said so."""
    status = run.status(cell)
    if status.state != "done" and cell.id in plan.impossible:
        return Status("skipped", plan.impossible[cell.id])
    return status


def _skip(plan: Plan, run: RunFolder) -> None:
    """Write down which cells cannot be run, and why."""
    for cell in plan.cells:
        status = status_in(plan, run, cell)
        if status != run.status(cell):
            run.finish(cell, status)


def estimate_seconds(plan: Plan, run: RunFolder) -> dict[str, float | None]:
    """Cell id -> seconds it took, or those of a finished one with the same backend and method; None without such."""
    took = {
        (stored.backend, stored.method): stored.status.seconds
        for stored in run.cells()
        if stored.status.state == "done"
    }
    own = {cell.id: run.status(cell) for cell in plan.cells}
    return {
        cell.id: own[cell.id].seconds
        if own[cell.id].state == "done"
        else took.get((cell.backend.name, cell.method.name if isinstance(cell, LearnerCell) else ""))
        for cell in plan.cells
    }


def describe_environment(plugins: Plugins, backends: Sequence[str]) -> dict[str, Any]:
    """Versions, CPU, git state, and the lines of the contract that the `backends` of the plan are known not to keep.

    What a reader needs to judge the numbers; none of it is part of a cell's id.
    """
    return {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": sys.argv,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "packages": {name: found for name in PACKAGES if (found := _version(name))},
        "plugins": {row.distribution: row.version for row in plugins.rows if not row.error},
        "known_gaps": {name: dict(plugins.backends[name].known_gaps) for name in backends},
        "git": _git(),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:  # not Linux
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _git() -> dict[str, Any] | None:
    """Commit of causalbench's own source and whether it was changed; None if it does not come from a git checkout."""

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", *arguments], cwd=Path(__file__).parent, capture_output=True, text=True, check=True, timeout=10
        ).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)  # else an installed copy inside a stranger's checkout
        return {"commit": git("rev-parse", "HEAD"), "changed": bool(git("status", "--porcelain", "--", "."))}
    except (OSError, subprocess.SubprocessError):
        return None
