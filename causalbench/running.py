"""A whole suite, from its file to its report: what `causalbench run` does, and `causalbench.run_suite`."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from causalbench.errors import UnfinishedRunError
from causalbench.plugins import manager
from causalbench.processes import use_one_thread_each
from causalbench.run.cell import Keeping
from causalbench.run.session import Execution, run_plan
from causalbench.run.view import Silent
from causalbench.store.run_folder import RunFolder
from causalbench.suite.plan import Plan, make_plan
from causalbench.suite.schema import SuiteFile, load_suite
from causalbench.suite.shipped import find_suite

if TYPE_CHECKING:
    from causalbench.report.frames import Results


def run_suite(
    suite: str | PathLike[str],
    tier: str = "quick",
    out: str | PathLike[str] | None = None,
    seeds: int | None = None,
    only: Sequence[str] = (),
    jobs: int | None = None,
    executor: Literal["processes", "serial"] = "processes",
) -> Results:
    """Run the missing cells of a tier of a suite, and return the tables of its run folder as pandas frames.

    - `suite` is a suite file, or the name of a suite that comes along, such as "pure_manip".
    - `out` is the run folder, by default `runs/<suite>-<tier>` in the working directory. If an earlier call was
      stopped, the same call continues, and so does the command `causalbench run`.
    - `seeds` replaces the number of seeds of the tier.
    - `only` keeps some of the cells: `["backend=kinematic,seed=0"]`.
    - `executor` is "processes", with a process for each cell and `jobs` at a time (None: one per core), or "serial",
      which runs the cells one after the other in this process.

    Raises `UserError` for a mistake in the suite or the arguments, before anything runs. Raises `UnfinishedRunError` at
    the end if a cell failed or was skipped; `load_results(out)` then has the results of the others.
    """
    use_one_thread_each()
    plan, folder, file = planned(suite, tier, out, seeds, only)
    execution = Execution(executor, jobs, None, False, Keeping())
    run_plan(plan, folder, file, manager.installed(), execution, Silent(), lambda: write_all(folder))
    unfinished = {cell.id: folder.status(cell) for cell in plan.cells if folder.status(cell).state != "done"}
    if unfinished:
        reasons = "; ".join(f"{name} {status.state}: {status.reason}" for name, status in unfinished.items())
        raise UnfinishedRunError(f"{folder.path}: {len(unfinished)} of {len(plan.cells)} cells are not done: {reasons}")
    from causalbench.report.frames import load_results

    return load_results(folder.path)


def planned(
    suite: str | PathLike[str], tier: str, out: str | PathLike[str] | None, seeds: int | None, only: Sequence[str]
) -> tuple[Plan, RunFolder, SuiteFile]:
    """The cells of a suite's tier, the folder for them, and the suite. Raises `UserError`."""
    file = load_suite(find_suite(Path(suite)), manager.installed())
    plan = make_plan(file, tier, manager.installed(), seeds, only)
    return plan, RunFolder(Path(out or f"runs/{file.suite.name}-{tier}")), file


def write_all(folder: RunFolder) -> None:
    """Write the tables, the pictures and the page of a run folder from its cells.

    Only this imports scipy, pandas and matplotlib, which cells need not wait for.
    """
    from causalbench.report.figures import write_run_figures
    from causalbench.report.html.page import write_page
    from causalbench.report.tables import write_tables

    found = write_tables(folder)
    write_run_figures(folder)
    write_page(folder, found)
