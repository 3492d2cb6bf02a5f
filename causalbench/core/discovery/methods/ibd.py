"""Interventional Boundary Discovery, turned from observations to rewards (Liu, Cheng, Bogdan 2026, arXiv 2603.18257).

D_random and D_do[a_k] differ in nothing but that a_k is 0 in the second. A two-sample test of every reward term, the
largest distance of the two distribution functions (Kolmogorov-Smirnov), says whether that can be seen, without a
model. Steps of one sequence resemble one another, so p-values come from exchanging whole sequences between the two
sets. Benjamini-Hochberg keeps the false-discovery rate of a stage at `fdr`. It compares distributions, not pairs:
what an action does to a reward must stand out of all that the other actions and the state do to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Lt
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.registry import Discoverer, StageProblem

Array = NDArray[np.float64]

STREAM = 106  # beside the numbers of the sets of samples and of the other discoverers
AT_ONCE = 100  # exchanges, for memory


@dataclass(frozen=True)
class IBDSettings:
    """Own settings of `ibd`."""

    fdr: Annotated[float, Gt(0), Lt(1)] = 0.05  # false-discovery rate of a stage


def discover_stage(problem: StageProblem) -> StageGraph:
    """Test every edge of one stage on the rewards of D_random and D_do."""
    from scipy.stats import false_discovery_control  # takes half a second to import

    data, rng = problem.samples(), np.random.default_rng([problem.seed, problem.stage, STREAM])
    testable, fdr = data.random.term_scale()[1], problem.options.fdr
    # A p-value is at least 1 / (exchanges + 1): enough of them that one edge alone can be selected.
    exchanges = math.ceil(2 * len(problem.task.actions) * len(problem.terms) / fdr)
    distance, p_value = np.zeros((2, len(problem.task.actions), len(problem.terms)))
    for k in range(len(distance)):
        both = data.random.joined(data.interventions[k])
        without = np.arange(len(both)) >= len(data.random)
        for j, rewards in enumerate(both.rewards.T):
            distance[k, j], p_value[k, j] = two_samples(rewards, without, both.sequence, exchanges, rng)
        problem.report((k + 1) / len(distance), "two-sample tests")
    p_adjusted = np.ones_like(p_value)
    if testable.any():
        p_adjusted[:, testable] = false_discovery_control(p_value[:, testable], axis=None).reshape(len(p_value), -1)
    evidence = {"ks": distance, "p_adjusted": p_adjusted}
    return StageGraph.decided(problem.task, problem.stage, p_adjusted <= fdr, testable, evidence)


def two_samples(
    values: NDArray[np.floating[Any]],
    second: NDArray[np.bool_],
    cluster: NDArray[np.int32],
    exchanges: int,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Kolmogorov-Smirnov distance of `values` (n,) where `second` (n,) holds from the others, and its p-value.

    `cluster` (n,) numbers the groups that are in one set as a whole and can be exchanged between both.
    """
    order = np.argsort(values, kind="stable")
    last_of_ties = np.append(np.diff(values[order]) > 0, True)
    first_rows = np.unique(cluster, return_index=True)[1]
    member = np.searchsorted(cluster[first_rows], cluster)[order]  # (n,) which cluster, in the order of the values

    def distances(labels: NDArray[np.bool_]) -> Array:
        """(n_labelings,) for `labels` (n_labelings, n_clusters)."""
        inside = labels[:, member].cumsum(1, dtype=np.int32)
        n_inside, below = inside[:, -1:], inside[:, last_of_ties]
        gap = below / n_inside - (np.flatnonzero(last_of_ties) + 1 - below) / (len(values) - n_inside)
        return np.asarray(np.abs(gap).max(1))

    own = second[first_rows]
    found = float(distances(own[None])[0])
    reached = 0
    for n in range(0, exchanges, AT_ONCE):
        labels = np.tile(own, (min(AT_ONCE, exchanges - n), 1))
        reached += int((distances(rng.permuted(labels, axis=1)) >= found - 1e-12).sum())
    return found, (1 + reached) / (1 + exchanges)


DISCOVERER = Discoverer(
    "ibd",
    discover_stage,
    "two-sample tests with and without the action (Interventional Boundary Discovery)",
    settings=IBDSettings,
    evidence=(
        EvidenceColumn("ks", "", "largest distance of the reward's distribution functions with and without the action",
                       main=True),
        EvidenceColumn("p_adjusted", "", "its p-value, adjusted for all edges of the stage (Benjamini-Hochberg)"),
    ),
    reads=frozenset({"random", "do"}),
)  # fmt: skip
