"""Causal discovery by rank correlation: does a reward stray further where an action is larger?"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Lt

from causalbench.discoverer import Discoverer, EvidenceColumn, StageGraph, StageProblem, hookimpl, varies


@dataclass(frozen=True)
class RankSettings:
    """In a suite: `discovery: {discoverer: rank_correlation, rank_correlation: {threshold: 0.1}}`."""

    threshold: Annotated[float, Gt(0), Lt(1)] = 0.1  # least correlation of a cause


def discover_stage(problem: StageProblem) -> StageGraph:
    """An edge where |a_k| and the distance of r_j from its mean have a Spearman correlation above the threshold."""
    from scipy.stats import spearmanr  # here, so that a list of discoverers costs nothing

    data = problem.samples().random
    testable = data.term_scale()[1]
    size = np.abs(data.actions[:, : len(problem.task.actions)])  # without the placebos
    stray = np.abs(data.rewards - data.rewards.mean(0))
    correlation = np.zeros((size.shape[1], stray.shape[1]))
    for j in np.flatnonzero(varies(stray)):  # a reward of two values may stray equally far to both sides
        for k in range(len(correlation)):
            correlation[k, j] = spearmanr(size[:, k], stray[:, j]).statistic
    present = correlation > problem.options.threshold
    return StageGraph.decided(problem.task, problem.stage, present, testable, {"correlation": correlation})


RANK_CORRELATION = Discoverer(
    "rank_correlation",
    discover_stage,
    "rank correlation of a reward's distance from its mean with the size of an action",
    settings=RankSettings,
    evidence=(EvidenceColumn("correlation", "", "Spearman's rank correlation of |a_k| and |r_j - mean|", main=True),),
    reads=frozenset(("random",)),
)


@hookimpl
def causalbench_discoverers(register: Callable[[Discoverer], None]) -> None:
    """Add the method to those that suites can name."""
    register(RANK_CORRELATION)
