"""Is the stated false-discovery rate kept? Both selections on kinematic, whose causes are known, seed by seed.

    python benchmarks/discovery_calibration.py --seeds $(seq 0 19)

One row per edge and seed, from the discovery of that seed where discoveries.py made one.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import torch
from discoveries import Row, existing, measured, options, put_together, quiet, read_graph

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.methods.kl.placebos import p_values
from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.pipeline import discover
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.discovery.truth.oracle import consult_oracle
from causalbench.core.kinematic import make
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.report.stats import wilson

NAME = "discovery_calibration"
STATES, ROUNDING = 200, 1e-9
FDR = KLSettings().fdr


def truth() -> list[np.ndarray]:
    """Per stage bool (n_actions, n_terms). Restoring is exact: an edge without effect shows rounding alone."""
    return [stage.effect > ROUNDING for stage in consult_oracle(TASK, make, STATES, 0, quiet)]


def graph_of(seed: int, discoveries: Path) -> CausalGraph:
    """The discovery of `seed` by the default settings."""
    made = existing(discoveries, "kinematic", seed)
    return read_graph(made) if made else discover(TASK, make, DiscoverySettings(), seed, quiet)


def edges(graph: CausalGraph, true: list[np.ndarray], seed: int) -> list[Row]:
    """One row per edge of one discovery."""
    kl, null_kl, q = ([stage.evidence[name] for stage in graph.stages] for name in ("kl", "null_kl", "q_value"))
    p = p_values(kl, null_kl)
    return [
        {
            "seed": seed,
            "stage": stage.stage,
            "reward": term,
            "action": action,
            "true": int(true[i][k, j]),
            "kl": kl[i][k, j],
            "p_value": p[i][k, j],
            "q_value": q[i][k, j],
            "paper": int(stage.matrix[k, j]),
            "fdr": int(q[i][k, j] <= FDR),
        }
        for i, stage in enumerate(graph.stages)
        for j, term in enumerate(stage.terms)
        for k, action in enumerate(stage.actions)
    ]


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Per selection: missed causes, and the wrong edges among the selected: pooled with a Wilson interval, by seed."""
    rows, causes = [], int(table["true"].sum())
    for name in ("paper", "fdr"):
        selected = table[table[name] == 1]
        wrong = int((selected["true"] == 0).sum())
        low, high = wilson(wrong, len(selected))
        by_seed = [(s["true"] == 0).sum() / max(len(s), 1) for _, s in selected.groupby("seed")]
        rows.append(
            {
                "select": name,
                "seeds": table["seed"].nunique(),
                "causes": causes,
                "missed": causes - (len(selected) - wrong),
                "selected": len(selected),
                "wrong": wrong,
                "share": wrong / max(len(selected), 1),
                "low": low,
                "high": high,
                "mean_over_seeds": float(np.mean(by_seed)),
            }
        )
    return pd.DataFrame(rows)


def p_values_of_absent_edges(table: pd.DataFrame) -> pd.DataFrame:
    """How often an absent edge has a p-value of at most so much; a valid one, no oftener than that."""
    null = table[table["true"] == 0]
    rows = []
    for level in (0.01, 0.05, 0.1, 0.5):
        below = int((null["p_value"] <= level).sum())
        low, high = wilson(below, len(null))
        rows.append({"p <=": level, "edges": len(null), "share": below / len(null), "low": low, "high": high})
    return pd.DataFrame(rows)


def main() -> None:
    """Run what is missing and print the summary."""
    args = options(__doc__, NAME, ("kinematic",), 20).parse_args()
    torch.set_num_threads(1)
    missing = [seed for seed in args.seeds if args.backends and not (args.work / f"{seed:02d}.csv").exists()]
    true = truth() if missing else []
    for seed in missing:
        measured(args.work / f"{seed:02d}.csv", lambda s=seed: edges(graph_of(s, args.discoveries), true, s))
    table = put_together(args.work, NAME, args.docs, ("seed",))
    print(summary(table).to_string(index=False))
    print(p_values_of_absent_edges(table).to_string(index=False))


if __name__ == "__main__":
    main()
