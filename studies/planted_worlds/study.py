"""Every discoverer on every kind of planted world: `python studies/planted_worlds/study.py OUT.csv`.

One row per edge. The same command again goes on where it ended. `--tables OUT.csv...` prints the page's tables.
"""

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causalbench import worlds
from causalbench.plugins.manager import installed
from causalbench.report.stats import wilson

KEYS = ["discoverer", "kind", "seed"]
SIZES = [0.0, 0.005, 0.015, 0.05, 0.1, 0.2, 0.5, 10.0]


def rows_of(discoverer: str, kind: str, seed: int) -> list[dict[str, Any]]:
    """One row per edge of the world of `kind` and `seed`."""
    world, began = worlds.planted(kind, seed), time.perf_counter()
    graph = worlds.discover(world, installed().discoverers[discoverer].configure(), seed)
    shared = {"discoverer": discoverer, "kind": kind, "seed": seed, "seconds": time.perf_counter() - began}
    shared["env_steps"] = graph.env_steps
    main, found = graph.main_column, []
    for stage in graph.stages:
        causes, effect = world.causes(stage.stage), worlds.effects(world, stage.stage)
        numbers = stage.evidence.get(main.name if main else "", np.zeros(causes.shape))
        for k, j in np.ndindex(causes.shape):
            edge = {"stage": stage.stage, "action": k, "term": j, "cause": int(causes[k, j]), "effect": effect[k, j]}
            number = -numbers[k, j] if main and main.name == "p_value" else numbers[k, j]
            found.append(shared | edge | {"outcome": stage.outcome(k, j), "evidence": number})
    return found


def run(out: Path, discoverers: list[str], kinds: list[str], seeds: int) -> None:
    """Write the rows of all that `out` does not have yet, world by world."""
    done = set(pd.read_csv(out).groupby(KEYS).groups) if out.exists() else set()
    for seed, kind, name in itertools.product(range(seeds), kinds, discoverers):
        if (name, kind, seed) not in done:
            table = pd.DataFrame(rows_of(name, kind, seed))
            table.to_csv(out, mode="a", header=not out.exists(), index=False, float_format="%.6g")


def share(part: int, whole: int) -> str:
    """`part` of `whole`, with Wilson's 95% interval."""
    if not whole:
        return ""
    low, high = wilson(int(part), int(whole))
    return f"{part}/{whole} [{low:.3f}, {high:.3f}]"


def summary(edges: pd.DataFrame) -> dict[str, Any]:
    """Counts over all edges of one group; an undecided edge is not found, and no mistake."""
    cause, found = edges["cause"] == 1, edges["outcome"] == "present"
    hits, wrong = int((cause & found).sum()), int((~cause & found).sum())
    strong = edges["effect"] >= 0.05
    worlds_of = edges.groupby(KEYS)
    ranks = [worlds.ranking(w["cause"].to_numpy(bool), w["evidence"].to_numpy(float)) for _, w in worlds_of]
    auroc, precision = (np.nanmean(column) if np.isfinite(column).any() else np.nan for column in np.array(ranks).T)
    return {
        "worlds": worlds_of.ngroups,
        "strong found": share((found & strong).sum(), strong.sum()),
        "all found": share(hits, cause.sum()),
        "wrong of selected": share(wrong, hits + wrong),
        "null selected": share(wrong, (~cause).sum()),
        "undecided": int((edges["outcome"] == "undecided").sum()),
        "F1": round(2 * hits / max(1, 2 * hits + wrong + int((cause & ~found).sum())), 3),
        "SHD": round((wrong + int((cause & ~found).sum())) / worlds_of.ngroups, 2),
        "AUROC": round(auroc, 3),
        "AP": round(precision, 3),
        "steps": round(worlds_of["env_steps"].first().mean()),
        "seconds": round(worlds_of["seconds"].first().mean(), 1),
    }


def table(edges: pd.DataFrame, by: list[str]) -> str:
    """`summary` of every group as a table in Markdown."""
    rows = [dict(zip(by, key, strict=True)) | summary(group) for key, group in edges.groupby(by, sort=False)]
    lines = [list(rows[0]), ["---"] * len(rows[0]), *([str(value) for value in row.values()] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Run or print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--discoverers", nargs="+", default=["anytime", "paired", "permutation", "fisher_z"])
    parser.add_argument("--kinds", nargs="+", default=list(worlds.KINDS), choices=list(worlds.KINDS))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--tables", action="store_true")
    asked = parser.parse_args()
    if not asked.tables:
        run(asked.out, asked.discoverers, asked.kinds, asked.seeds)
        return
    edges = pd.read_csv(asked.out)
    edges["restores"] = np.where(edges["kind"].str.contains("noise_"), "inexact", "exact")
    edges.loc[edges["kind"].str.contains("snapshots"), "restores"] = "none"
    edges["size"] = pd.cut(edges["effect"], SIZES).astype(str)
    print(table(edges, ["restores", "discoverer"]), table(edges, ["kind", "discoverer"]), sep="\n\n")
    print("\n" + table(edges[edges["cause"] == 1].sort_values("effect"), ["restores", "size", "discoverer"]))


if __name__ == "__main__":
    main()
