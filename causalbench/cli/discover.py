"""`causalbench discover`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causalbench.cli.options import cores, named_values
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.errors import UserError

DEFAULT = DiscoverySettings().discoverer


def discover(
    backend: Annotated[str, typer.Option(help="Where to discover.")] = "kinematic",
    task: Annotated[str, typer.Option(help="What for.")] = "pure_manipulation",
    discoverer: Annotated[str, typer.Option(help="How: one of docs/discovery.md or a plugin's.")] = DEFAULT,
    preset: Annotated[str, typer.Option(help="Named settings: quick, paper, paper_large.")] = "quick",
    setting: Annotated[
        list[str] | None, typer.Option("--set", help="A setting, any discoverer's or its own: name=value (repeatable).")
    ] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    oracle: Annotated[bool, typer.Option("--oracle", help="Score it against counterfactuals from snapshots.")] = False,
    data: Annotated[
        Path | None, typer.Option(help="Folder `data` of an earlier discovery: use its samples, run no simulator.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for graph.json, evidence.csv and the samples.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes that collect (default: one per core).")] = None,
) -> None:
    """Discover the causal graph of a task, print it beside its evidence; write graph.json, evidence.csv and data/."""
    from causalbench.cli.terminal_tables import print_graph, print_oracle
    from causalbench.report.figures import write_discovery_figures
    from causalbench.run.alone import choose_settings, discover_alone, infer_alone

    changed = named_values(setting or (), "--set", "training_count=1000")
    settings = choose_settings(discoverer, preset, changed)
    name = "-".join([discoverer, preset, *(f"{key}-{value}" for key, value in changed.items())])
    if data is not None:
        if oracle:
            raise UserError("--oracle asks the simulator: run it without --data")
        folder = out or data.parent / name
        graph = infer_alone(data, settings, folder)
        write_discovery_figures(folder)
        print_graph(graph, folder)
        return
    folder = out or Path("runs") / f"discover-{task}-{backend}-{name}-s{seed}"
    graph, truth = discover_alone(task, backend, settings, seed, oracle, folder, jobs or cores())
    write_discovery_figures(folder)
    print_graph(graph, folder)
    if truth is not None:
        print_oracle(graph, truth)
