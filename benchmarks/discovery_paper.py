"""The paper's data sizes and optimisation against the default: decisions compared, both judged by one oracle.

    python benchmarks/discovery_paper.py --backends kinematic --seeds 0 1 2
    python benchmarks/discovery_paper.py --backends gymrob --seeds 0

The default is the discovery of that backend and seed. One row per preset; `discovery_paper_edges.csv` has every KL.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd
from discoveries import Row, cpu_seconds, folder, judged, measured, options, put_together, quiet, read_graph, read_truth

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.pipeline import discover
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins.manager import installed
from causalbench.store.cells import DATA
from causalbench.store.samples import SampleFolder

NAME, EDGES = "discovery_paper", "discovery_paper_edges"


def paper_graph(backend: str, seed: int, work: Path) -> tuple[CausalGraph, Row]:
    """The graph by the paper's preset and the seconds it took; an interrupted one keeps its samples."""
    path, taken = work / f"{backend}-{seed}", Row()
    path.mkdir(parents=True, exist_ok=True)
    with cpu_seconds(taken):
        make, store = installed().backend(backend).make, SampleFolder(path / DATA)
        graph = discover(TASK, make, DISCOVERERS["kl"].configure("paper"), seed, quiet, store=store)
    (path / "graph.json").write_text(graph.to_json(), encoding="utf-8")
    return graph, taken


def rows_of(backend: str, seed: int, made: Path, work: Path) -> list[Row]:
    """A row per preset, `differs` naming the edges that only one of them has."""
    truth, default = read_truth(made), read_graph(made)
    paper, taken = paper_graph(backend, seed, work)
    rows = []
    for preset, graph, other in (("paper", paper, default), ("quick", default, paper)):
        only = [
            f"{one.stage}:{one.actions[k]}>{one.terms[j]}"
            for one, two in zip(graph.stages, other.stages, strict=True)
            for k, j in zip(*(one.matrix & ~two.matrix).nonzero(), strict=True)
        ]
        row = Row(backend=backend, seed=seed, preset=preset, env_steps=graph.env_steps)
        rows.append(row | judged(graph, truth) | {"only_here": " ".join(only)} | (taken if preset == "paper" else {}))
    return rows


def edges_of(backend: str, seed: int, made: Path, work: Path) -> list[Row]:
    """KL and decision of every edge by both presets, and the oracle's grade."""
    graphs = {"paper": read_graph(work / f"{backend}-{seed}"), "quick": read_graph(made)}
    return [
        Row(backend=backend, seed=seed, stage=stage.stage, reward=term, action=action)
        | {f"kl_{name}": graph.stages[stage.stage - 1].evidence["kl"][k, j] for name, graph in graphs.items()}
        | {f"selected_{name}": int(graph.stages[stage.stage - 1].matrix[k, j]) for name, graph in graphs.items()}
        | {"effect": stage.effect[k, j], "grade": stage.grades()[k][j].value}
        for stage in read_truth(made)
        for j, term in enumerate(stage.terms)
        for k, action in enumerate(stage.actions)
    ]


def main() -> None:
    """Run what is missing and print the table."""
    args = options(__doc__, NAME, ("kinematic",), 1).parse_args()
    for backend in args.backends:
        for seed in args.seeds:
            made, name = folder(args.discoveries, backend, seed), f"{backend}-{seed}.csv"
            measured(args.work / name, partial(rows_of, backend, seed, made, args.work))
            measured(args.work / "edges" / name, partial(edges_of, backend, seed, made, args.work))
    put_together(args.work / "edges", EDGES, args.docs)
    table: pd.DataFrame = put_together(args.work, NAME, args.docs)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
