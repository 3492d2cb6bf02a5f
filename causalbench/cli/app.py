"""The command line. Commands import what they need when they run, so that `--help` is quick and imports no torch."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from causalbench.errors import CausalbenchError, UserError

if TYPE_CHECKING:
    from causalbench.run.session import Execution
    from causalbench.store.cells import RunFolder
    from causalbench.suite.plan import Plan
    from causalbench.suite.schema import SuiteFile

EXIT_FAILED, EXIT_MISTAKE, EXIT_INTERRUPTED = 1, 2, 130

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


class TierOption(StrEnum):
    """How much to run."""

    smoke = "smoke"
    quick = "quick"
    full = "full"


class ExecutorOption(StrEnum):
    """How to run."""

    serial = "serial"
    processes = "processes"


SuiteArgument = Annotated[Path, typer.Argument(help="Suite file, such as suites/pure_manip.yaml.")]
Tier = Annotated[TierOption, typer.Option(help="smoke: a minute; quick: one seed; full: the published table.")]
Seeds = Annotated[int | None, typer.Option(min=1, help="Run seeds 0 to N-1 instead of the tier's number.")]
Only = Annotated[list[str] | None, typer.Option(help="Keep some cells: backend=A,method=B,seed=0 (repeatable).")]
Out = Annotated[Path | None, typer.Option(help="Run folder (default: runs/<suite>-<tier>).")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Cells at a time (default: one per core).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


@app.callback()
def causalbench() -> None:
    """Does knowing which actions cause which rewards make multi-stage robot tasks learnable, in any simulator?"""


@app.command()
def run(
    suite: SuiteArgument,
    tier: Tier = TierOption.quick,
    seeds: Seeds = None,
    only: Only = None,
    out: Out = None,
    jobs: Jobs = None,
    executor: Annotated[
        ExecutorOption, typer.Option(help="A process per cell, or all in this one.")
    ] = ExecutorOption.processes,
    timeout: Annotated[float | None, typer.Option(min=0.001, help="Minutes that a cell may take.")] = None,
    retry_failed: Annotated[
        bool, typer.Option(help="Run diverged and timed-out cells again, too; failed ones always are.")
    ] = False,
    checkpoint_every: Annotated[
        int, typer.Option(min=1, help="Environment steps after which a learner keeps what a killed run continues from.")
    ] = 2_000,
    tensorboard: Annotated[bool, typer.Option(help="Also write each cell's curves for TensorBoard.")] = False,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option(help="Show no progress.")] = False,
) -> None:
    """Run a suite, or what is missing of it, and print the leaderboard."""
    # Set before numpy is imported: a cell has one core, and sums must not depend on how many there are.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from causalbench.run.cell import Keeping
    from causalbench.run.session import Execution
    from causalbench.run.tensorboard import summary_writer

    if tensorboard:
        summary_writer()  # says at once if it is missing
    plan, folder, file = _plan(suite, tier, seeds, only, out)
    seconds = None if timeout is None else 60 * timeout
    execution = Execution(
        executor.value, jobs or _cores(), seconds, retry_failed, Keeping(checkpoint_every, tensorboard)
    )
    try:
        _execute(plan, folder, file, execution, quiet or as_json)
    except KeyboardInterrupt:
        typer.echo("stopped; the same command continues with what is missing", err=True)
        raise typer.Exit(EXIT_INTERRUPTED) from None
    states = [folder.status(cell).state for cell in plan.cells]
    _print_run(plan, folder, as_json)
    if any(state != "done" for state in states):
        raise typer.Exit(EXIT_FAILED)


@app.command()
def plan(
    suite: SuiteArgument,
    tier: Tier = TierOption.quick,
    seeds: Seeds = None,
    only: Only = None,
    out: Out = None,
    jobs: Jobs = None,
    as_json: AsJson = False,
) -> None:
    """Show what `run` would do, with times estimated from cells that have run."""
    from causalbench.cli.terminal_tables import print_plan
    from causalbench.run.session import estimate_seconds

    chosen, folder, _ = _plan(suite, tier, seeds, only, out)
    estimates = estimate_seconds(chosen, folder)
    rows = [
        {
            "cell": cell.id,
            "kind": cell.identity["kind"],
            "state": folder.status(cell).state,
            "seconds": estimates[cell.id],
        }
        for cell in chosen.cells
    ]
    if as_json:
        _print_json({"out": str(folder.path), "cells": rows})
    else:
        print_plan(rows, folder.path, jobs or _cores())


@app.command()
def discover(
    backend: Annotated[str, typer.Option(help="Where to discover.")] = "kinematic",
    task: Annotated[str, typer.Option(help="What for.")] = "pure_manipulation",
    discoverer: Annotated[str, typer.Option(help="How: the paper's kl, or another of docs/discovery.md.")] = "kl",
    preset: Annotated[str, typer.Option(help="Named settings: quick, paper, paper_mobile.")] = "quick",
    select: Annotated[str, typer.Option(help="paper: Algorithm 2; fdr: what stands out from placebos.")] = "paper",
    fdr: Annotated[float, typer.Option(min=0.0, max=1.0, help="Share of wrong edges that --select fdr allows.")] = 0.05,
    action_repeat: Annotated[int, typer.Option(min=1, help="Control steps for which an action is held.")] = 1,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    oracle: Annotated[bool, typer.Option("--oracle", help="Score it against counterfactuals from snapshots.")] = False,
    data: Annotated[
        Path | None, typer.Option(help="Folder `data` of an earlier discovery: use its samples, run no simulator.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for graph.json, kl.csv and the samples.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes that collect (default: one per core).")] = None,
) -> None:
    """Discover the causal graph of a task, print it beside its KL values, and write graph.json, kl.csv and data/."""
    from causalbench.cli.terminal_tables import print_graph, print_oracle
    from causalbench.report.figures import write_discovery_figures
    from causalbench.run.alone import choose_settings, discover_alone, infer_alone

    settings = choose_settings(discoverer, preset, select, fdr, action_repeat)
    name = f"{discoverer}-{preset}" if select == "paper" else f"{discoverer}-{preset}-{select}"
    name += f"-x{action_repeat}" if action_repeat > 1 else ""
    if data is not None:
        if oracle:
            raise UserError("--oracle asks the simulator: run it without --data")
        folder = out or data.parent / name
        graph = infer_alone(data, settings, folder)
        write_discovery_figures(folder)
        print_graph(graph, folder)
        return
    folder = out or Path("runs") / f"discover-{task}-{backend}-{name}-s{seed}"
    graph, truth = discover_alone(task, backend, settings, seed, oracle, folder, jobs or _cores())
    write_discovery_figures(folder)
    print_graph(graph, folder)
    if truth is not None:
        print_oracle(graph, truth)


@app.command()
def leaderboard(
    runs: Annotated[list[Path], typer.Argument(help="One or more run folders, ranked together.")],
    as_json: AsJson = False,
) -> None:
    """Print the leaderboard of one run, or of several that can be compared."""
    from causalbench.cli.terminal_tables import print_known_gaps, print_leaderboard
    from causalbench.report.tables import merged_leaderboard
    from causalbench.store.cells import RunFolder

    folders = [RunFolder(path) for path in runs]
    rows = merged_leaderboard(folders)
    if as_json:
        _print_json(rows)
    else:
        print_leaderboard(rows)
        print_known_gaps(folders)


@app.command()
def play(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    only: Only = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each policy.")] = 1,
) -> None:
    """Film trained policies of a run: videos/*.mp4 in its folder."""
    from causalbench.run.play import play
    from causalbench.store.cells import RunFolder

    for path in play(RunFolder(run), only or (), episodes):
        typer.echo(path)


@app.command()
def backends() -> None:
    """List simulators, and plugins that could not be loaded."""
    from causalbench.cli.terminal_tables import print_backends
    from causalbench.plugins.manager import installed

    print_backends(installed())


@app.command()
def check(
    backend: Annotated[str, typer.Argument(help="Registered name, such as kinematic.")],
    option: Annotated[list[str] | None, typer.Option(help="Option of the backend: name=value (repeatable).")] = None,
    as_json: AsJson = False,
) -> None:
    """Check a backend against the numbered contract of docs/conformance.md."""
    from causalbench.cli.terminal_tables import print_checks
    from causalbench.conformance.suite import FAIL, run_checks
    from causalbench.plugins.manager import installed

    results = run_checks(installed().backend(backend), _options(option or ()))
    if as_json:
        rows = list(map(vars, results))
        _print_json({"backend": backend, "checks": rows})
    else:
        rows = print_checks(backend, map(vars, results))
    if any(row["outcome"] == FAIL for row in rows):
        raise typer.Exit(EXIT_FAILED)


@app.command()
def new_backend(
    name: Annotated[str, typer.Argument(help="Name to register, such as my_sim.")],
    out: Annotated[Path, typer.Option(help="Where the new folder NAME_backend goes.")] = Path(),
) -> None:
    """Write a plugin that passes `check`, for you to put your simulator into."""
    from causalbench.scaffold import write_backend

    folder = write_backend(name, out)
    typer.echo(f"wrote {folder}; now: pip install -e {folder} && causalbench check {name}, then {folder}/README.md")


def _options(given: Iterable[str]) -> dict[str, Any]:
    """`["timestep=0.002"]` as keyword arguments; a value that is no number, true or false stays a string."""
    import json

    options = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise UserError(f"--option {text!r}: expected name=value, such as control_hz=20")
        try:
            options[name] = json.loads(value)
        except ValueError:
            options[name] = value
    return options


@app.command()
def doctor(jobs: Jobs = None) -> None:
    """Try every simulator and look for what makes runs fail or crawl; exit code 1 if anything needs mending."""
    from causalbench.cli.terminal_tables import print_finding
    from causalbench.plugins.manager import installed
    from causalbench.run.doctor import examine

    found = []
    for finding in examine(installed(), jobs or _cores()):
        print_finding(finding)
        found.append(finding.ok)
    if not all(found):
        raise typer.Exit(EXIT_FAILED)


def _plan(
    suite: Path, tier: TierOption, seeds: int | None, only: list[str] | None, out: Path | None
) -> tuple[Plan, RunFolder, SuiteFile]:
    from causalbench.plugins.manager import installed
    from causalbench.store.cells import RunFolder
    from causalbench.suite.plan import make_plan
    from causalbench.suite.schema import load_suite

    file = load_suite(suite)
    plan = make_plan(file, tier.value, installed(), seeds, only or ())
    return plan, RunFolder(out or Path("runs") / f"{file.suite.name}-{tier.value}"), file


def _execute(plan: Plan, folder: RunFolder, file: SuiteFile, execution: Execution, quiet: bool) -> None:
    from causalbench.cli.progress import choose_view
    from causalbench.cli.terminal_tables import progress_console
    from causalbench.plugins.manager import installed
    from causalbench.report.figures import write_run_figures
    from causalbench.report.tables import write_tables
    from causalbench.run.session import run_plan

    view = choose_view(quiet, progress_console())

    def report() -> None:
        write_tables(folder)
        write_run_figures(folder)

    run_plan(plan, folder, file, installed(), execution, view, report)


def _print_run(plan: Plan, folder: RunFolder, as_json: bool) -> None:
    from causalbench.cli.terminal_tables import print_known_gaps, print_leaderboard, print_unfinished
    from causalbench.report.tables import merged_leaderboard

    rows = merged_leaderboard([folder])
    statuses = {cell.id: folder.status(cell) for cell in plan.cells}
    if as_json:
        cells = [{"cell": name, "state": status.state, "reason": status.reason} for name, status in statuses.items()]
        _print_json({"out": str(folder.path), "cells": cells, "leaderboard": rows})
        return
    print_leaderboard(rows)
    print_known_gaps([folder])
    print_unfinished(statuses, folder.path)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _print_json(content: Any) -> None:
    import json

    typer.echo(json.dumps(content, indent=1))


def main() -> None:
    """The command `causalbench`: a user's mistake is one message and exit code 2, never a traceback."""
    try:
        app()
    except UserError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(EXIT_MISTAKE)
    except CausalbenchError as error:
        typer.echo(f"failed: {error}", err=True)
        sys.exit(EXIT_FAILED)
