"""How many samples discovery needs: F1 against the oracle on nested subsets of one collection, per method.

    python benchmarks/discovery_curve.py --backends kinematic gymrob --seeds 0 1 2 3 4

Up to 3,000 samples a set are the first of those that the discovery of that backend and seed kept, whose graph stands
for `kl` at 3,000; only for 10,000 is more collected, of which they are the first, too (`nested`: whether that is so).
Writes docs/figures/discovery_curve.svg.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from discoveries import (
    Row,
    by_fdr,
    cpu_seconds,
    decide,
    folder,
    judged,
    measured,
    options,
    put_together,
    read_graph,
    read_samples,
    read_truth,
    stages_of,
)

from causalbench.core.discovery.methods.independence import KCISettings
from causalbench.core.discovery.samples.streams import Recipe
from causalbench.core.discovery.samples.transitions import StageSamples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins.manager import installed
from causalbench.store.cells import DATA
from causalbench.store.samples import SampleFolder

NAME = "discovery_curve"
KEPT = DiscoverySettings().training_count
SIZES = (300, 1_000, KEPT, 10_000)
METHODS = ("kl", "cmi", "fisher_z", "kci")
FDR = "kl, select: fdr"
STYLES = {"kl": ("#0072B2", "o"), FDR: ("#D55E00", "s"), "cmi": ("#009E73", "^"), "fisher_z": ("#E69F00", "D"),
          "kci": ("#CC79A7", "v")}  # fmt: skip


def collected(backend: str, seed: int, count: int, made: Path, work: Path) -> list[StageSamples]:
    """The samples of every stage, at least `count` a set."""
    if count <= KEPT:
        return read_samples(made)
    origin, _ = SampleFolder(made / DATA).origin()
    settings, store = DiscoverySettings(training_count=count), SampleFolder(work / f"{backend}-{seed}-{count}")
    return stages_of(Recipe(TASK, settings, seed, origin, installed().backend(backend).make, store))


def nested(wholes: list[StageSamples], made: Path) -> bool:
    """Whether the samples begin with those of the discovery."""
    return all(
        np.array_equal(more.random.states[:KEPT], less.random.states)
        and np.array_equal(more.interventions[-1].rewards[:KEPT], less.interventions[-1].rewards)
        for more, less in zip(wholes, read_samples(made), strict=True)
    )


def rows_of(backend: str, seed: int, method: str, size: int, made: Path, work: Path) -> list[Row]:
    """The row of one method and size; two for `kl`, whose fit serves both selections."""
    settings = DiscoverySettings(discoverer=method, training_count=size)
    row, truth = Row(backend=backend, seed=seed, samples=size, method=method), read_truth(made)
    if (method, size) == ("kl", KEPT):
        graph = read_graph(made)
    else:
        wholes = collected(backend, seed, size, made, work)
        row["nested"] = size <= KEPT or nested(wholes, made)
        with cpu_seconds(row):
            graph = decide(wholes, settings, seed)
    rows = [row | judged(graph, truth)]
    if method == "kl":
        rows.append(row | {"method": FDR} | judged(by_fdr(graph), truth))
    return rows


def draw(table: pd.DataFrame, path: Path) -> None:
    """Mean F1 over seeds by method, on all stages and on stages 1 to 3."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "causalbench", "font.size": 9.0})
    backends = list(dict.fromkeys(table["backend"]))
    figure = Figure(figsize=(3.9 * len(backends) + 1.3, 5.4), layout="constrained")
    axes = figure.subplots(2, len(backends), squeeze=False, sharex=True, sharey=True)
    for (row, column), ax in np.ndenumerate(axes):
        measure, what = (("f1_stages_1_3", "stages 1 to 3"), ("f1", "all stages"))[row]
        here = table[table["backend"] == backends[column]]
        for method, (colour, marker) in STYLES.items():
            by_size = here[here["method"] == method].groupby("samples")[measure]
            middle = by_size.mean()
            ax.fill_between(middle.index, by_size.min(), by_size.max(), color=colour, alpha=0.12, lw=0)
            ax.plot(middle.index, middle, color=colour, marker=marker, ms=5, label=method)
        ax.set_xscale("log")
        ax.set_xticks(SIZES, [f"{size:,}" for size in SIZES])
        ax.minorticks_off()
        ax.set_ylim(0, 1.03)
        seeds = here.groupby(["method", "samples"])["seed"].nunique()
        ax.set_title(f"{backends[column]}, {what}, {' to '.join(map(str, sorted({seeds.min(), seeds.max()})))} seeds")
        if row == 1:
            ax.set_xlabel("samples in each set of a stage")
        if column == 0:
            ax.set_ylabel("F1: mean, worst, best")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Run what is missing and draw."""
    parser = options(__doc__, NAME, ("kinematic", "gymrob"), 5)
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    args = parser.parse_args()
    for size in args.sizes:  # the cheap ones first, for all seeds
        for backend in args.backends:
            for seed in args.seeds:
                made = folder(args.discoveries, backend, seed)
                for method in METHODS:
                    if method == "kci" and size > KCISettings().samples:
                        continue  # its cost is cubic
                    path = args.work / f"{backend}-{seed}-{size}-{method}.csv"
                    measured(path, partial(rows_of, backend, seed, method, size, made, args.work))
    table = put_together(args.work, NAME, args.docs, ("backend", "seed", "samples", "method"))
    draw(table, args.docs.parent / "figures" / f"{NAME}.svg")


if __name__ == "__main__":
    main()
