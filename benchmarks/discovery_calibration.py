"""Is the stated false-discovery rate kept? Both selections on kinematic, whose causes are known, seed by seed.

    python benchmarks/discovery_calibration.py --seeds 20 --out docs/data/discovery_calibration.csv

One row per edge and seed. Seeds that the file already has are not run again.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from causalbench.core.discovery.calibration import p_values
from causalbench.core.discovery.graph import CausalGraph, used_kl
from causalbench.core.discovery.oracle import consult_oracle
from causalbench.core.discovery.pipeline import discover
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.report.stats import wilson

STATES = 200


def quiet(share: float, doing: str) -> None:
    """No progress: one line a seed is enough."""


def edges(
    graph: CausalGraph, settings: DiscoverySettings, true: list[np.ndarray], seed: int
) -> list[dict[str, object]]:
    """One row per edge of one discovery."""
    kl = [used_kl(graph, stage.stage) for stage in graph.stages]
    p = p_values(kl, [np.asarray(stage.null_kl) for stage in graph.stages])
    return [
        {
            "seed": seed,
            "stage": stage.stage,
            "reward": term,
            "action": action,
            "true": int(true[i][k, j]),
            "kl": kl[i][k, j],
            "p_value": p[i][k, j],
            "q_value": np.asarray(stage.q_value)[k, j],
            "paper": int(stage.matrix[k, j]),
            "fdr": int(np.asarray(stage.q_value)[k, j] <= settings.fdr),
        }
        for i, stage in enumerate(graph.stages)
        for j, term in enumerate(stage.terms)
        for k, action in enumerate(stage.actions)
    ]


def summarise(table: pd.DataFrame) -> None:
    """Per selection: missed causes, wrong edges among the selected (Wilson interval, and mean over seeds)."""
    causes = int(table["true"].sum())
    print(f"{table['seed'].nunique()} seeds, {len(table)} edges, {causes} of them causes")
    for name in ("paper", "fdr"):
        selected = table[table[name] == 1]
        wrong = int((selected["true"] == 0).sum())
        low, high = wilson(wrong, len(selected))
        by_seed = [(s["true"] == 0).sum() / max(len(s), 1) for _, s in selected.groupby("seed")]
        missed = causes - (len(selected) - wrong)
        print(
            f"{name}: {missed} causes missed; {wrong} of {len(selected)} selected are wrong: "
            f"{wrong / max(len(selected), 1):.3f} [{low:.3f}, {high:.3f}]; mean over seeds {np.mean(by_seed):.3f}"
        )
    null = table[table["true"] == 0]
    for level in (0.01, 0.05, 0.1, 0.5):
        below = int((null["p_value"] <= level).sum())
        low, high = wilson(below, len(null))
        print(f"p <= {level}: {below / len(null):.3f} [{low:.3f}, {high:.3f}] of {len(null)} absent edges")


def main() -> None:
    """Run what is missing and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--samples", type=int, default=DiscoverySettings().training_count)
    parser.add_argument("--out", type=Path, default=Path("docs/data/discovery_calibration.csv"))
    args = parser.parse_args()
    torch.set_num_threads(1)
    settings = DiscoverySettings(training_count=args.samples)
    # Restoring is exact here, so that an edge without effect shows exactly none.
    true = [stage.effect > 0 for stage in consult_oracle(TASK, make, STATES, 0, quiet)]
    table = pd.read_csv(args.out) if args.out.exists() else pd.DataFrame({"seed": []})
    for seed in range(args.seeds):
        if seed in set(table["seed"]):
            continue
        graph = discover(TASK, make, settings, seed, quiet)
        table = pd.concat([table, pd.DataFrame(edges(graph, settings, true, seed))] if len(table) else
                          [pd.DataFrame(edges(graph, settings, true, seed))])  # fmt: skip
        args.out.parent.mkdir(parents=True, exist_ok=True)
        table.to_csv(args.out, index=False, lineterminator="\n", float_format="%.6g")
        print(f"seed {seed} done", flush=True)
    summarise(table)


if __name__ == "__main__":
    main()
