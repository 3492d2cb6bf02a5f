"""A causal graph as tables: the paper's wide Table I and II, and one long row per (stage, reward, action)."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from causalbench.core.discovery.graph import CausalGraph, used_kl
from causalbench.core.discovery.truth.oracle import StageTruth
from causalbench.core.discovery.truth.score import score_rows


def kl_table(graph: CausalGraph) -> pd.DataFrame:
    """One row per (stage, reward): KL of each action in the direction used, cv, then the normalised values.

    Empty for a graph that another discoverer than `kl` made.
    """
    rows = []
    for stage in graph.stages:
        if stage.kl is None:  # nothing could be decided there
            continue
        kl = used_kl(graph, stage.stage)
        for j, term in enumerate(stage.terms):
            row: dict[str, object] = {"stage": stage.stage, "reward": term}
            row |= dict(zip(stage.actions, kl[:, j], strict=True)) | {"cv": stage.cv[j]}  # type: ignore[index]
            row |= {f"{a}_n": v for a, v in zip(stage.actions, stage.kl_normalised[:, j], strict=True)}  # type: ignore[index]
            rows.append(row)
    return pd.DataFrame(rows)


def evidence_table(graph: CausalGraph) -> pd.DataFrame:
    """One row per (stage, reward, action): what a discoverer other than `kl` decided by, and its decision."""
    rows = [
        {"stage": stage.stage, "reward": term, "action": action}
        | {name: values[k, j] for name, values in stage.evidence.items()}
        | {"selected": bool(stage.matrix[k, j])}
        for stage in graph.stages
        for j, term in enumerate(stage.terms)
        for k, action in enumerate(stage.actions)
    ]
    return pd.DataFrame(rows)


def oracle_table(graph: CausalGraph, truth: Sequence[StageTruth]) -> pd.DataFrame:
    """One row per (stage, reward, action): effect with its interval, grade, and whether discovery selected it.

    `floor` is the effect that repeating the same action shows: 0 where restoring is exact.
    """
    rows = [
        {
            "stage": stage.stage,
            "reward": term,
            "action": action,
            "effect": stage.effect[k, j],
            "effect_low": stage.low[k, j],
            "effect_high": stage.high[k, j],
            "floor": stage.floor[j],
            "grade": grades[k][j].value,
            "selected": bool(found.matrix[k, j]),
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
