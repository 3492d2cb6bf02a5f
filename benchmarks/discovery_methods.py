"""Discovery methods side by side: F1 against the oracle, seconds, samples read and environment steps.

    python benchmarks/discovery_methods.py --seeds 0 1 2

Methods that work on samples read those of the discovery of that backend and seed, so that nothing is collected twice;
all are judged by its oracle, which shares no random number with them. `kl` is fitted again for seed 0 alone, for its
seconds; otherwise its graph is the discovery's.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd
from discoveries import (
    BACKENDS,
    Row,
    by_fdr,
    cpu_seconds,
    folder,
    judged,
    measured,
    options,
    put_together,
    quiet,
    read_graph,
    read_truth,
)

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.methods.independence import KCISettings
from causalbench.core.discovery.pipeline import discover, discover_from_samples
from causalbench.core.discovery.samples.streams import streams
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins.manager import installed
from causalbench.store.cells import DATA
from causalbench.store.samples import SampleFolder

NAME = "discovery_methods"
ON_SAMPLES = ("kl", "cmi", "fisher_z", "kci")


def rows_of(backend: str, seed: int, method: str, made: Path) -> list[Row]:
    """The row of one method; two for `kl`, whose fit serves both selections."""
    settings, row = DiscoverySettings(discoverer=method), Row(backend=backend, seed=seed, method=method)
    if method == "kl" and seed > 0:
        graph = read_graph(made)
    elif method in ON_SAMPLES:
        store = SampleFolder(made / DATA)
        origin, about = store.origin()
        with cpu_seconds(row):
            graph = discover_from_samples(TASK, store, origin, settings, about["seed"], quiet)
    else:
        with cpu_seconds(row):
            graph = discover(TASK, installed().backend(backend).make, settings, seed, quiet)
    truth = read_truth(made)
    row |= {"samples": samples_read(method, settings, graph), "env_steps": graph.env_steps}
    rows = [row | judged(graph, truth)]
    if method == "kl":
        rows.append(row | {"method": "kl, select: fdr"} | judged(by_fdr(graph), truth))
    return rows


def samples_read(method: str, settings: DiscoverySettings, graph: CausalGraph) -> int:
    """Transitions that a method looked at, of those that were collected."""
    if method not in ON_SAMPLES:
        return graph.env_steps
    if method == "kci":
        return TASK.n_stages * KCISettings().samples
    return sum(
        stream.count
        for stage in range(1, TASK.n_stages + 1)
        for stream in streams(TASK, settings, stage, DISCOVERERS[method].reads)
    )


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds."""
    numbers = ["f1", "f1_stages_1_3", "cpu_seconds", "samples", "env_steps"]
    groups = table.groupby(["backend", "method"], sort=False)
    return groups[numbers].mean().assign(seeds=groups["seed"].nunique()).reset_index()


def main() -> None:
    """Fill the table and print it."""
    parser = options(__doc__, NAME, BACKENDS, 3)
    parser.add_argument("--methods", nargs="+", default=list(DISCOVERERS), choices=list(DISCOVERERS))
    args = parser.parse_args()
    for backend in args.backends:
        for seed in args.seeds:
            made = folder(args.discoveries, backend, seed)
            for method in args.methods:
                path = args.work / f"{backend}-{seed}-{method}.csv"
                measured(path, partial(rows_of, backend, seed, method, made))
    table = put_together(args.work, NAME, args.docs, ("backend", "seed", "method"))
    print(summary(table).round(2).to_string(index=False))


if __name__ == "__main__":
    main()
