"""Scores of discovered edges against the oracle, from rows of `discovery.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd


def read_edges(run: Path) -> pd.DataFrame:
    """The rows of `discovery.csv` in the folder of a run; an empty `grid_point` is the empty text."""
    edges = pd.read_csv(run / "discovery.csv")
    return edges.assign(grid_point=edges["grid_point"].fillna(""))


def edge_scores(edges: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Precision, recall and F1 of the selected edges among the absent and the strong ones, a row per group of `by`.

    `edges` are rows of `discovery.csv` whose discovery asked an oracle; weak and untestable edges do not count. `seeds`
    are those that were discovered, `missed` and `false` count edges over all of them.
    """
    told = edges[edges["oracle_grade"].isin(["absent", "strong"])]
    strong, selected = told["oracle_grade"] == "strong", told["selected"] == 1
    counted = told.assign(right=strong & selected, missed=strong & ~selected, false=~strong & selected)
    groups = counted.groupby(list(by))
    out = groups[["right", "missed", "false"]].sum().assign(seeds=groups["seed"].nunique())
    found, there = out["right"] + out["false"], out["right"] + out["missed"]
    return out.assign(
        precision=(out["right"] / found).fillna(1.0),
        recall=(out["right"] / there).fillna(1.0),
        f1=(2 * out["right"] / (found + there)).fillna(1.0),
    )
