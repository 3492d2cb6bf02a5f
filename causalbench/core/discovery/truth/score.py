"""A discovered matrix against the oracle: precision, recall, F1 and structural Hamming distance.

The graph is bipartite and directed from actions to terms, so an edge is there or not: SHD is the number of wrong cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.truth.oracle import Grade, StageTruth


@dataclass(frozen=True)
class Score:
    """Counts of edges; the ratios are 1 where nothing was there to be found or nothing was selected wrongly.

    An edge that was left undecided is missed where it is there, and no mistake where it is not.
    """

    true_positives: int
    false_positives: int
    false_negatives: int

    @property
    def precision(self) -> float:
        """Share of the selected edges that are there."""
        return _share(self.true_positives, self.true_positives + self.false_positives)

    @property
    def recall(self) -> float:
        """Share of the edges that are there that were selected."""
        return _share(self.true_positives, self.true_positives + self.false_negatives)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return _share(2 * self.true_positives, 2 * self.true_positives + self.shd)

    @property
    def shd(self) -> int:
        """Edges that would have to be added or removed."""
        return self.false_positives + self.false_negatives

    def __add__(self, other: Score) -> Score:
        return Score(
            self.true_positives + other.true_positives,
            self.false_positives + other.false_positives,
            self.false_negatives + other.false_negatives,
        )


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 1.0


def score_matrix(matrix: NDArray[np.bool_], grades: list[list[Grade]], weak_is_present: bool | None = None) -> Score:
    """Score `matrix` (n_actions, n_terms). Untestable cells never count; weak ones if `weak_is_present` is given."""
    true_positives = false_positives = false_negatives = 0
    for row, row_grades in zip(matrix, grades, strict=True):
        for selected, grade in zip(row, row_grades, strict=True):
            if grade == Grade.untestable or (grade == Grade.weak and weak_is_present is None):
                continue
            present = grade == Grade.strong or (grade == Grade.weak and bool(weak_is_present))
            true_positives += bool(selected and present)
            false_positives += bool(selected and not present)
            false_negatives += bool(present and not selected)
    return Score(true_positives, false_positives, false_negatives)


def score_graph(graph: CausalGraph, truth: Iterable[StageTruth], weak_is_present: bool | None = None) -> list[Score]:
    """One score per stage; their sum scores the whole graph."""
    return [
        score_matrix(found.matrix, stage.grades(), weak_is_present)
        for found, stage in zip(graph.stages, truth, strict=True)
    ]


def score_rows(graph: CausalGraph, truth: Sequence[StageTruth]) -> list[dict[str, Any]]:
    """One row per stage and one for all: scores on absent and strong edges, and F1 with weak edges as present."""
    plain, with_weak = score_graph(graph, truth), score_graph(graph, truth, weak_is_present=True)
    undecided = [int(found.left_open.sum()) for found in graph.stages]
    names, nothing = [*(str(stage.stage) for stage in truth), "all"], Score(0, 0, 0)
    both = zip([*plain, sum(plain, nothing)], [*with_weak, sum(with_weak, nothing)], strict=True)
    return [
        {
            "stage": name,
            "precision": score.precision,
            "recall": score.recall,
            "f1": score.f1,
            "shd": score.shd,
            "f1_weak_present": weak.f1,
            "left_undecided": left,
        }
        for name, left, (score, weak) in zip(names, [*undecided, sum(undecided)], both, strict=True)
    ]


def with_score(graph: CausalGraph, truth: Sequence[StageTruth]) -> CausalGraph:
    """The graph with its `oracle` filled: scores, error floor per stage and term, and what the oracle cost apart."""
    return replace(
        graph,
        oracle={
            "states": truth[0].states,
            "env_steps": sum(stage.env_steps for stage in truth),
            "exact_restore": all(stage.exact_restore for stage in truth),
            "floor": {
                str(stage.stage): {
                    term: None if np.isnan(value) else float(value)
                    for term, value in zip(stage.terms, stage.floor, strict=True)
                }
                for stage in truth
            },
            "scores": score_rows(graph, truth),
        },
    )
