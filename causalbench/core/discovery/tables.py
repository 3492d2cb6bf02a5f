"""A causal graph as tables: one long row per (stage, term, action)."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from causalbench.core.discovery.edges import EDGE, edge_rows, evidence_columns
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.truth.oracle import StageTruth
from causalbench.core.discovery.truth.score import score_rows


def evidence_table(graph: CausalGraph) -> pd.DataFrame:
    """`edge_rows` as a frame."""
    return pd.DataFrame(edge_rows(graph), columns=[*EDGE, *evidence_columns(graph)])


def oracle_table(graph: CausalGraph, truth: Sequence[StageTruth]) -> pd.DataFrame:
    """One row per (stage, term, action): effect with its interval, grade, and whether discovery selected it.

    `floor` is the effect that repeating the same action shows: 0 where restoring is exact.
    """
    rows = [
        {
            "stage": stage.stage,
            "term": term,
            "action": action,
            "effect": stage.effect[k, j],
            "effect_low": stage.low[k, j],
            "effect_high": stage.high[k, j],
            "floor": stage.floor[j],
            "grade": grades[k][j].value,
            "outcome": found.outcome(k, j),
            "selected": int(found.matrix[k, j]),
        }
        for found, stage in zip(graph.stages, truth, strict=True)
        for grades in [stage.grades()]
        for j, term in enumerate(stage.terms)
        for k, action in enumerate(stage.actions)
    ]
    return pd.DataFrame(rows)


def score_table(graph: CausalGraph, truth: Sequence[StageTruth]) -> pd.DataFrame:
    """One row per stage and one for all: scores on absent and strong edges, and with weak edges counted as present."""
    return pd.DataFrame(score_rows(graph, truth))
