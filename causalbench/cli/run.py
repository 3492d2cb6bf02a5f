"""`causalbench run` and `causalbench plan`."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from causalbench.cli.execution import execute
from causalbench.cli.options import (
    EXIT_FAILED,
    AsJson,
    Jobs,
    Only,
    Out,
    Seeds,
    SuiteArgument,
    Tier,
    named_values,
    print_json,
)
from causalbench.cli.until_decided import execute_until_decided
from causalbench.processes import cores, use_one_thread_each

if TYPE_CHECKING:
    from causalbench.run.measure import Needs
    from causalbench.store.run_folder import RunFolder
    from causalbench.suite.cells import Cell
    from causalbench.suite.plan import Plan


class ExecutorOption(StrEnum):
    """How to run."""

    serial = "serial"
    processes = "processes"
    ray = "ray"
    slurm = "slurm"


def run(
    suite: SuiteArgument,
    tier: Tier = "quick",
    seeds: Seeds = None,
    only: Only = None,
    out: Out = None,
    jobs: Jobs = None,
    executor: Annotated[
        ExecutorOption,
        typer.Option(
            help="A process per cell, all in one process, or a cluster job per cell (docs/how-to/cluster.md)."
        ),
    ] = ExecutorOption.processes,
    ray_address: Annotated[
        str | None, typer.Option(help="Address of the Ray cluster (default: this machine's).")
    ] = None,
    slurm: Annotated[list[str] | None, typer.Option(help="Option of sbatch: name=value (repeatable).")] = None,
    timeout: Annotated[
        float | None,
        typer.Option(min=0.001, help="Minutes that a cell may take (default: ten times what such a cell took)."),
    ] = None,
    memory: Annotated[
        float | None,
        typer.Option(min=0.001, help="Gigabytes that the processes of a cell may take (default: no limit)."),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option(help="Also run diverged and timed-out cells again; failed cells always run again.")
    ] = False,
    checkpoint_every: Annotated[
        int, typer.Option(min=1, help="Environment steps from one checkpoint of a training to the next.")
    ] = 2_000,
    until_decided: Annotated[
        bool, typer.Option(help="Add seeds until every stated hypothesis is decided or the tier's seeds are used up.")
    ] = False,
    tensorboard: Annotated[bool, typer.Option(help="Also write the curves of each cell for TensorBoard.")] = False,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option(help="Show no progress.")] = False,
) -> None:
    """Run the missing cells of a suite and print the leaderboard."""
    use_one_thread_each()
    from causalbench.run.cell import Keeping
    from causalbench.run.session import Execution
    from causalbench.run.tensorboard import summary_writer
    from causalbench.running import planned

    if tensorboard:
        summary_writer()  # says at once if it is missing
    plan, folder, file = planned(suite, tier, out, seeds, only or ())
    seconds = None if timeout is None else 60 * timeout
    keeping = Keeping(checkpoint_every, tensorboard)
    options = named_values(slurm or (), "--slurm", "time=240")
    most = None if memory is None else 1e9 * memory
    execution = Execution(executor.value, jobs, seconds, retry_failed, keeping, ray_address, options, most)
    if until_decided:
        plan = execute_until_decided(plan, folder, file, execution, quiet or as_json)
    else:
        execute(plan, folder, file, execution, quiet or as_json)
    states = [folder.status(cell).state for cell in plan.cells]
    _print_run(plan, folder, as_json)
    if any(state != "done" for state in states):
        raise typer.Exit(EXIT_FAILED)


def plan(
    suite: SuiteArgument,
    tier: Tier = "quick",
    seeds: Seeds = None,
    only: Only = None,
    out: Out = None,
    jobs: Jobs = None,
    measure: Annotated[
        bool, typer.Option(help="Try a cell of each kind that has not run yet, for some seconds each.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show what `run` would do and how long it takes, from cells that have run or, with --measure, by trying them."""
    use_one_thread_each()
    from causalbench.cli.terminal_tables import print_plan, print_problems
    from causalbench.run.session import estimate_seconds, status_in
    from causalbench.running import planned

    chosen, folder, _ = planned(suite, tier, out, seeds, only or ())
    print_problems([folder])
    estimates = estimate_seconds(chosen, folder)
    states = {cell.id: status_in(chosen, folder, cell).state for cell in chosen.cells}
    needs = _measured(cell for cell in chosen.cells if states[cell.id] not in ("done", "skipped")) if measure else {}
    rows = []
    for cell in chosen.cells:
        known, seconds = needs.get(cell.id), estimates[cell.id]
        rows.append(
            {
                "cell": cell.id,
                "kind": cell.identity["kind"],
                "state": states[cell.id],
                "env_steps": cell.identity.get("env_steps"),
                "seconds": known.seconds if known and seconds is None else seconds,
                "disk": known.disk if known else None,
                "memory": known.memory if known else None,
            }
        )
    if as_json:
        print_json({"out": str(folder.path), "cells": rows})
    else:
        print_plan(rows, folder.path, jobs or cores())


def _measured(cells: Iterable[Cell]) -> dict[str, Needs]:
    from causalbench.run.measure import measure

    return measure(cells, lambda text: typer.echo(text, err=True))


def _print_run(plan: Plan, folder: RunFolder, as_json: bool) -> None:
    from causalbench.cli.terminal_tables import print_hypotheses, print_known_gaps, print_leaderboard, print_unfinished
    from causalbench.report.tables import merged_boards

    verdicts, rows = merged_boards([folder])
    statuses = {cell.id: folder.status(cell) for cell in plan.cells}
    if as_json:
        cells = [{"cell": name, "state": status.state, "reason": status.reason} for name, status in statuses.items()]
        print_json({"out": str(folder.path), "cells": cells, "verdicts": verdicts, "leaderboard": rows})
        return
    print_hypotheses(verdicts)
    if rows:
        print_leaderboard(rows)
    print_known_gaps([folder])
    print_unfinished(statuses, folder.path)
