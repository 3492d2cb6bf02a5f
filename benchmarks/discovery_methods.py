"""Discovery methods side by side: F1 against the oracle, seconds, samples read and environment steps.

python benchmarks/discovery_methods.py --backends kinematic gymrob --seeds 2 --out methods

Samples are collected once per (backend, seed) and read by every method that works on them; each oracle and each result
is a file in --out, so that the same command continues. The oracle's seed is 1000 plus the method's.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from causalbench.core.discovery.collection import streams
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.oracle import Grade, consult_oracle
from causalbench.core.discovery.pipeline import discover
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins import installed
from causalbench.store.files import write_text
from causalbench.store.samples import SampleFolder

STATES = 400  # of the oracle, per stage
READS = {"cmi": ("random", "inference"), "fisher_z": ("random",), "kci": ("random",)}
ON_SAMPLES = ("kl", *READS)


def grades(backend: str, seed: int, out: Path) -> pd.DataFrame:
    """stage, reward, action, grade of an oracle that shares no random number with the methods."""
    path = out / f"{backend}-oracle-{seed}.csv"
    if not path.exists():
        truth = consult_oracle(TASK, installed().backend(backend).make, STATES, 1000 + seed, lambda share, text: None)
        rows = [
            (stage.stage, term, action, stage.grades()[k][j].value)
            for stage in truth
            for j, term in enumerate(stage.terms)
            for k, action in enumerate(stage.actions)
        ]
        write_text(path, pd.DataFrame(rows, columns=["stage", "reward", "action", "grade"]).to_csv(index=False))
    return pd.read_csv(path)


def result(backend: str, seed: int, method: str, out: Path) -> dict[str, object]:
    """The row of one method, from its file if it has one."""
    path = out / f"{backend}-{method}-{seed}.csv"
    if path.exists():
        return pd.read_csv(path).to_dict("records")[0]
    truth, settings = grades(backend, seed, out), replace(DiscoverySettings(), discoverer=method)
    store = SampleFolder(out / f"{backend}-{seed}-data")
    make = installed().backend(backend).make

    def quiet(share: float, text: str) -> None:
        pass

    if method in ON_SAMPLES and not (store.path / "collected").exists():
        discover(TASK, make, replace(settings, discoverer="fisher_z"), seed, quiet, store=store)
        write_text(store.path / "collected", "")
    started = time.perf_counter()
    graph = discover(TASK, make, settings, seed, quiet, store=store if method in ON_SAMPLES else None)
    row = {"method": method, "backend": backend, "seed": seed}
    row |= score(graph, truth) | {"seconds": time.perf_counter() - started}
    row |= {"samples": samples_read(method, settings, graph), "env_steps": graph.env_steps}
    write_text(path, pd.DataFrame([row]).to_csv(index=False))
    return row


def samples_read(method: str, settings: DiscoverySettings, graph: CausalGraph) -> int:
    """Transitions that a method looked at, of those that were collected."""
    if method not in ON_SAMPLES:
        return graph.env_steps
    if method == "kci":
        return TASK.n_stages * settings.kci_samples
    return sum(
        stream.count
        for stage in range(1, TASK.n_stages + 1)
        for stream in streams(TASK, settings, stage)
        if stream.name in READS.get(method, (stream.name,))
    )


def score(graph: CausalGraph, truth: pd.DataFrame) -> dict[str, float]:
    """F1 on strong and absent edges, and what was missed and wrongly found."""
    stages = [graph.stages[row.stage - 1] for row in truth.itertuples()]
    cells = zip(stages, truth.action, truth.reward, strict=True)
    found = np.array([stage.matrix[stage.actions.index(a), stage.terms.index(r)] for stage, a, r in cells])
    strong, absent = (truth.grade == Grade.strong).to_numpy(), (truth.grade == Grade.absent).to_numpy()
    hits, missed, false = (found & strong).sum(), (~found & strong).sum(), (found & absent).sum()
    return {"f1": 2 * hits / (2 * hits + missed + false), "strong": strong.sum(), "missed": missed, "false": false}


def main() -> None:
    """Fill the table and print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backends", nargs="+", default=["kinematic", "gymrob"])
    parser.add_argument("--methods", nargs="+", default=list(DISCOVERERS), choices=list(DISCOVERERS))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("discovery_methods"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    rows = []
    for backend in args.backends:
        for seed in range(args.seeds):
            for method in args.methods:
                rows.append(result(backend, seed, method, args.out))
                print(rows[-1], flush=True)
    table = pd.DataFrame(rows).groupby(["backend", "method"], sort=False).mean(numeric_only=True).drop(columns="seed")
    print(table.round(2).to_string())


if __name__ == "__main__":
    main()
