"""The edges of a causal graph as rows: what was decided of each, and by which numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from causalbench.core.discovery.graph import CausalGraph

EDGE = ("stage", "term", "action", "outcome", "selected", "in_policy")
"""The columns that every table of edges has, whatever the discoverer."""
ORACLE = ("effect", "effect_low", "effect_high", "grade")
"""What an oracle says of an edge; beside what a discoverer found these are `oracle_effect` and so on."""
RESERVED = ("task", "backend", "grid_point", "seed", *EDGE, *(f"oracle_{name}" for name in ORACLE))
"""Names that no evidence may have, since a table has such a column already."""


def evidence_columns(graph: CausalGraph) -> tuple[str, ...]:
    """The names of the columns that a row per edge can show, in the order of the discoverer."""
    return tuple(column.name for column in graph.columns if column.per != "stage")


def edge_rows(graph: CausalGraph) -> Iterator[dict[str, Any]]:
    """One row per (stage, term, action): the decision, whether a policy sets the action, and the evidence.

    A number of a term stands in each of its rows; None where the stage has no such number.
    """
    names = evidence_columns(graph)
    for stage in graph.stages:
        tables = [np.broadcast_to(stage.evidence.get(name, np.nan), stage.matrix.shape) for name in names]
        for j, term in enumerate(stage.terms):
            for k, action in enumerate(stage.actions):
                row: dict[str, Any] = {"stage": stage.stage, "term": term, "action": action}
                row |= {"outcome": stage.outcome(k, j), "selected": int(stage.matrix[k, j])}
                row["in_policy"] = int(action in stage.policy_actions())
                numbers = (float(table[k, j]) for table in tables)
                yield row | {n: None if math.isnan(x) else x for n, x in zip(names, numbers, strict=True)}
