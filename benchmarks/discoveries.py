"""Discoveries with oracle and samples, made once and read by every discovery benchmark.

    python benchmarks/discoveries.py --backends kinematic gymrob robosuite pybullet --seeds 5 --out runs/discoveries

Each is what `causalbench discover --backend B --oracle --seed S --out OUT/B-sS` runs; one that is there is kept, and
one that was interrupted continues. What the benchmarks measure is kept likewise, a small file per measurement in their
`--work` folder, from which the tables in docs/data are put together.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from pages import DOCS, merge_into, write

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.methods.kl.placebos import calibrate
from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.registry import StageProblem
from causalbench.core.discovery.samples.collection import Collection
from causalbench.core.discovery.samples.streams import Recipe
from causalbench.core.discovery.samples.transitions import Samples, StageSamples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.discovery.truth.oracle import Grade, StageTruth
from causalbench.core.discovery.truth.score import Score, score_graph
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.tasks.task import Task
from causalbench.core.world.scene import Scene
from causalbench.store.cells import DATA
from causalbench.store.samples import SampleFolder

BACKENDS = ("kinematic", "gymrob", "robosuite", "pybullet")
RUNS = Path("runs/discoveries")
Row = dict[str, Any]


def quiet(share: float, doing: str) -> None:
    """No progress: one line a measurement is enough."""


def existing(root: Path, backend: str, seed: int) -> Path | None:
    """The folder of a discovery's cell; None if it is not there."""
    return next((path.parent for path in (root / f"{backend}-s{seed}").glob("discovery/*/graph.json")), None)


def folder(root: Path, backend: str, seed: int) -> Path:
    """The folder of a discovery's cell, which is run if it is not there."""
    if (path := existing(root, backend, seed)) is None:
        out = root / f"{backend}-s{seed}"
        given = ("--backend", backend, "--seed", str(seed), "--out", str(out), "--jobs", "1", "--oracle", "--quiet")
        subprocess.run([sys.executable, "-m", "causalbench", "discover", *given], check=True)
        return folder(root, backend, seed)
    return path


def read_graph(path: Path) -> CausalGraph:
    """The graph in the folder of a discovery."""
    return CausalGraph.load(path / "graph.json")


def read_truth(path: Path) -> tuple[StageTruth, ...]:
    """What the oracle said there."""
    graph, table = read_graph(path), pd.read_csv(path / "oracle.csv")

    def matrix(here: pd.DataFrame, stage: int, column: str) -> np.ndarray:
        found = graph.stages[stage - 1]
        return (
            here.pivot(index="action", columns="reward", values=column).loc[[*found.actions], [*found.terms]].to_numpy()
        )

    return tuple(
        StageTruth(
            found.stage, found.actions, found.terms,
            *(matrix(here, found.stage, name) for name in ("effect", "effect_low", "effect_high")),
            matrix(here, found.stage, "floor")[0], bool(graph.oracle["exact_restore"]), graph.oracle["states"],
        )
        for found in graph.stages for here in [table[table["stage"] == found.stage]]
    )  # fmt: skip


def read_samples(path: Path) -> list[StageSamples]:
    """The samples of every stage in the folder of a discovery by the default settings."""
    store = SampleFolder(path / DATA)
    origin, about = store.origin()
    recipe = Recipe(TASK, DiscoverySettings(), about["seed"], origin, None, store)
    return stages_of(recipe)


def stages_of(recipe: Recipe) -> list[StageSamples]:
    """The samples of every stage by `recipe`, from its store where it has them."""
    collection = Collection(recipe, 1, lambda stage, share: None)
    try:
        return [collection.stage(stage) for stage in range(1, recipe.task.n_stages + 1)]
    finally:
        collection.close()


@dataclass
class Subset:
    """The `StageProblem` of the first `training_count` samples of each set of one stage."""

    task: Task
    stage: int
    settings: DiscoverySettings
    seed: int
    whole: StageSamples

    @property
    def options(self) -> Any:
        """The discoverer's own."""
        return self.settings.options

    @property
    def terms(self) -> tuple[str, ...]:
        """The stage's."""
        return self.task.stage_terms(self.stage, discoverable_only=True)

    def samples(self) -> StageSamples:
        """Nested: what a smaller `training_count` holds, a larger one holds, too."""
        count = self.settings.training_count
        inference = self.whole.inference.first(round(self.settings.inference_fraction * count))
        interventions = tuple(samples.first(count) for samples in self.whole.interventions)
        extra = self.whole.extra and self.whole.extra.first(count)
        return StageSamples(self.whole.random.first(count), inference, interventions, extra)

    def scene(self) -> Scene:
        """Samples are all there is."""
        raise NotImplementedError

    def walk(self, rng: np.random.Generator) -> Walk:
        """Nor is there a walk."""
        raise NotImplementedError

    def keep(self, name: str, samples: Samples) -> None:
        """Nothing is kept."""

    def report(self, share: float, doing: str) -> None:
        """No progress."""


def decide(wholes: list[StageSamples], settings: DiscoverySettings, seed: int) -> CausalGraph:
    """What `settings.discoverer` makes of the first samples of every stage."""
    discoverer = DISCOVERERS[settings.discoverer]
    settings = discoverer.complete(settings)
    problems: list[StageProblem] = [Subset(TASK, i, settings, seed, whole) for i, whole in enumerate(wholes, 1)]
    stages = tuple(map(discoverer.discover_stage, problems))
    return CausalGraph(TASK.name, TASK.version, "discovered", stages)


def by_fdr(graph: CausalGraph) -> CausalGraph:
    """The same fit, its edges selected by the placebos' distribution."""
    return replace(graph, stages=calibrate(graph.stages, DiscoverySettings(options=KLSettings(select="fdr"))))


def judged(graph: CausalGraph, truth: tuple[StageTruth, ...]) -> Row:
    """F1 on absent and strong edges of all stages and of stages 1 to 3, and every wrong edge by name."""
    scores = score_graph(graph, truth)
    total, early = sum(scores, Score(0, 0, 0)), sum(scores[:3], Score(0, 0, 0))
    wrong: dict[str, list[str]] = {"missed": [], "false": []}
    for found, stage in zip(graph.stages, truth, strict=True):
        for k, row in enumerate(stage.grades()):
            for j, grade in enumerate(row):
                edge = f"{stage.stage}:{stage.actions[k]}>{stage.terms[j]}"
                if grade == Grade.strong and not found.matrix[k, j]:
                    wrong["missed"].append(edge)
                if grade == Grade.absent and found.matrix[k, j]:
                    wrong["false"].append(edge)
    row = {"f1": total.f1, "f1_stages_1_3": early.f1, "precision": total.precision, "recall": total.recall}
    return row | {"shd": total.shd} | {name: " ".join(edges) for name, edges in wrong.items()}


@contextmanager
def cpu_seconds(row: Row) -> Iterator[None]:
    """Adds `cpu_seconds`, those of this process: other work on the machine does not count."""
    torch.set_num_threads(1)
    started = time.process_time()
    yield
    row["cpu_seconds"] = time.process_time() - started


def measured(path: Path, measure: Callable[[], Iterable[Row]]) -> None:
    """Write the rows of one measurement to `path`, unless they are there."""
    if path.exists():
        return
    table = pd.DataFrame(list(measure()))
    write(path, table)
    print(path if len(table) > 8 else table.to_string(index=False), flush=True)


def put_together(work: Path, name: str, docs: Path, keys: Sequence[str] = ("backend", "seed")) -> pd.DataFrame:
    """docs/NAME.csv, after the measurements in `work` have replaced its rows of the same `keys`."""
    files = sorted(work.glob("*.csv"))
    if files:
        new = pd.concat([pd.read_csv(path) for path in files], ignore_index=True)
        merge_into(docs / f"{name}.csv", new, keys)
    return pd.read_csv(docs / f"{name}.csv")


def options(about: str | None, name: str, backends: tuple[str, ...], seeds: int) -> argparse.ArgumentParser:
    """The options that all discovery benchmarks have."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="*", default=backends, help="none: only put the tables together")
    parser.add_argument("--seeds", type=int, nargs="*", default=range(seeds))
    parser.add_argument("--discoveries", type=Path, default=RUNS, help="folder that discoveries.py filled")
    parser.add_argument("--work", type=Path, default=Path("runs") / name, help="where each measurement is kept")
    parser.add_argument("--docs", type=Path, default=DOCS, help="where the table goes")
    return parser


def main() -> None:
    """Run the discoveries that are missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="+", default=BACKENDS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=RUNS)
    args = parser.parse_args()
    for backend in args.backends:
        for seed in range(args.seeds):
            print(folder(args.out, backend, seed), flush=True)


if __name__ == "__main__":
    main()
