"""How many samples discovery needs: F1 against the oracle on nested subsets of one collection, per selection.

    python benchmarks/discovery_curve.py --backend kinematic --seeds 5 --out docs/data

Writes discovery_curve.csv and, from all rows in it, discovery_curve.svg. Rows that the file already has are kept.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
import torch

from causalbench.core.discovery.calibration import calibrate
from causalbench.core.discovery.collect import StageSamples
from causalbench.core.discovery.collection import Collection, Origin, Recipe
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.kl import discover_stage
from causalbench.core.discovery.oracle import StageTruth, consult_oracle
from causalbench.core.discovery.score import score_rows
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.scene import Scene
from causalbench.core.tasks.task import Task
from causalbench.plugins import installed

SIZES = (300, 1_000, 3_000, 10_000)
STATES = 400
SELECTIONS = ("paper", "fdr")


@dataclass
class Subset:
    """The `StageProblem` of the first `count` samples of each set of one stage."""

    task: Task
    stage: int
    settings: DiscoverySettings
    seed: int
    whole: StageSamples

    def samples(self) -> StageSamples:
        """Nested: what a smaller `training_count` holds, a larger one holds, too."""
        count = self.settings.training_count
        inference = self.whole.inference.first(round(self.settings.inference_fraction * count))
        interventions = tuple(samples.first(count) for samples in self.whole.interventions)
        extra = self.whole.extra and self.whole.extra.first(count)
        return StageSamples(self.whole.random.first(count), inference, interventions, extra)

    def scene(self) -> Scene:
        """Never asked for by `kl`."""
        raise NotImplementedError

    def keep(self, name: str, samples: object) -> None:
        """Nothing is kept."""

    def report(self, share: float, doing: str) -> None:
        """No progress: one line a graph is enough."""


def rows_of_seed(task: Task, backend: str, seed: int, sizes: list[int], truth: tuple[StageTruth, ...]) -> pd.DataFrame:
    """Scores of all stages together, for every size and selection."""
    make = installed().backend(backend).make
    scene = make()
    origin = Origin.of(scene.spec)
    scene.close()
    settings = DiscoverySettings(training_count=max(SIZES))
    collection = Collection(Recipe(task, settings, seed, origin, make, None), 1, lambda stage, share: None)
    wholes = [collection.stage(stage) for stage in range(1, task.n_stages + 1)]
    collection.close()
    rows = []
    for size in sizes:
        small = replace(settings, training_count=size)
        stages = tuple(discover_stage(Subset(task, i, small, seed, whole)) for i, whole in enumerate(wholes, 1))
        for selection in SELECTIONS:
            provenance = {"settings": {"direction": small.direction, "select": selection, "fdr": small.fdr}}
            graph = calibrate(CausalGraph(task.name, task.version, "discovered", stages, provenance=provenance))
            score = score_rows(graph, truth)[-1]
            key = {"backend": backend, "seed": seed, "samples": size, "selection": selection}
            rows.append(key | {name: score[name] for name in ("precision", "recall", "f1", "shd", "f1_weak_present")})
        print(backend, "seed", seed, size, {row["selection"]: row["f1"] for row in rows[-2:]}, flush=True)
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame, path: Path) -> None:
    """Mean F1 over seeds, with a line for the worst and the best seed."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "causalbench"})
    backends = list(dict.fromkeys(table["backend"]))
    figure = Figure(figsize=(4.2 * len(backends), 3.2), layout="constrained")
    for ax, backend in zip(figure.subplots(1, len(backends), squeeze=False)[0], backends, strict=True):
        here = table[table["backend"] == backend]
        for selection, colour, marker in zip(SELECTIONS, ("#0072B2", "#D55E00"), "os", strict=True):
            by_size = here[here["selection"] == selection].groupby("samples")["f1"]
            ax.fill_between(by_size.mean().index, by_size.min(), by_size.max(), color=colour, alpha=0.15, lw=0)
            ax.plot(by_size.mean().index, by_size.mean(), color=colour, marker=marker, label=f"select: {selection}")
        ax.set_xscale("log")
        ax.set_xticks(SIZES, [f"{size:,}" for size in SIZES])
        ax.minorticks_off()
        ax.set_ylim(0, 1.03)
        ax.set_xlabel("samples in each set of a stage")
        ax.set_ylabel("F1 on absent and strong edges")
        ax.set_title(f"{backend}, {here['seed'].nunique()} seeds: mean, worst and best")
        ax.legend(loc="lower right", frameon=False)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Run what is missing, a seed at a time, and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", default="kinematic")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("docs/data"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    task, file = installed().task("pure_manipulation"), args.out / "discovery_curve.csv"
    table = pd.read_csv(file) if file.exists() else None
    truth = None
    for seed in range(args.seeds):
        done = set() if table is None else set(table[(table.backend == args.backend) & (table.seed == seed)]["samples"])
        missing = [size for size in SIZES if size not in done]
        if not missing:
            continue
        truth = truth or consult_oracle(task, installed().backend(args.backend).make, STATES, 0, lambda *_: None)
        new = rows_of_seed(task, args.backend, seed, missing, truth)
        table = new if table is None else pd.concat([table, new])
        args.out.mkdir(parents=True, exist_ok=True)
        table.to_csv(file, index=False, lineterminator="\n", float_format="%.6g")
    draw(pd.read_csv(file), args.out / "discovery_curve.svg")


if __name__ == "__main__":
    main()
