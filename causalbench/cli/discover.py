"""`causalbench discover`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from causalbench.cli.execution import execute
from causalbench.cli.options import EXIT_FAILED, BackendOptions, named_values
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.errors import UserError
from causalbench.processes import cores, use_one_thread_each

DEFAULT = DiscoverySettings().discoverer


def discover(
    backend: Annotated[str | None, typer.Option(help="Backend on which to discover (default: the task's own).")] = None,
    task: Annotated[str, typer.Option(help="Task whose causal graph is discovered.")] = "pure_manipulation",
    discoverer: Annotated[str, typer.Option(help="Discoverer: one of docs/discovery.md, or a plugin's.")] = DEFAULT,
    preset: Annotated[str, typer.Option(help="Named settings: quick, paper, paper_large.")] = "quick",
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", help="Setting of the discovery or the discoverer: name=value (repeatable)."),
    ] = None,
    option: BackendOptions = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the samples and of the models.")] = 0,
    oracle: Annotated[
        bool, typer.Option("--oracle", help="Grade the graph by interventions on restored states.")
    ] = False,
    data: Annotated[
        Path | None,
        typer.Option(help="Folder `data` of an earlier discovery, whose samples are used; no simulator runs."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Run folder.")] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes that collect samples (default: one per core).")
    ] = None,
    quiet: Annotated[bool, typer.Option(help="Show no progress.")] = False,
) -> None:
    """Discover the causal graph of a task and print it with its evidence. This is a run of one cell."""
    use_one_thread_each()
    from causalbench.plugins.manager import installed
    from causalbench.plugins.venues import venue_of
    from causalbench.suite.one_discovery import discovery_section

    given = named_values(setting or (), "--set", "training_count=1000")
    options = named_values(option or (), "--option", "control_hz=20")
    section = discovery_section(discoverer, preset, given, installed())
    name = "-".join([discoverer, preset, *(f"{key}-{value}" for key, value in {**given, **options}.items())])
    if data is not None:
        if oracle:
            raise UserError("--oracle asks the simulator: run it without --data")
        _from_samples(data, section, out or data.parent / name)
        return
    if oracle:
        from causalbench.core.discovery.truth.oracle import ORACLE_STATES

        section = {"oracle_states": ORACLE_STATES} | section
    place = backend or venue_of(installed().task(task)).home
    folder = out or Path("runs") / f"discover-{task}-{place}-{name}-s{seed}".replace("/", "_")
    _run(task, place, seed, section, options, folder, jobs or cores(), quiet)


def _run(
    task: str, backend: str, seed: int, section: Mapping[str, Any], options: Mapping[str, Any],
    out: Path, jobs: int, quiet: bool,
) -> None:  # fmt: skip
    from causalbench.cli.terminal_tables import print_graph, print_oracle, print_unfinished
    from causalbench.plugins.manager import installed
    from causalbench.run.cell import Keeping
    from causalbench.run.session import Execution
    from causalbench.store.run_folder import RunFolder
    from causalbench.suite.one_discovery import plan_discovery

    plan, file = plan_discovery(task, backend, seed, section, options, installed())
    run, (cell,) = RunFolder(out), plan.cells
    execute(plan, run, file, Execution("processes", jobs, None, True, Keeping()), quiet)
    status = run.status(cell)
    if status.state != "done":
        print_unfinished({cell.id: status}, run.path)
        raise typer.Exit(EXIT_FAILED)
    graph = run.stored(cell).graph()
    print_graph(graph, run.folder(cell))
    if graph.oracle:
        print_oracle(graph, run.folder(cell))


def _from_samples(data: Path, section: Mapping[str, Any], folder: Path) -> None:
    from causalbench.cli.terminal_tables import print_graph
    from causalbench.report.figures import write_discovery_figures
    from causalbench.run.from_samples import discover_from_folder

    graph = discover_from_folder(data, section, folder)
    write_discovery_figures(folder)
    print_graph(graph, folder)
