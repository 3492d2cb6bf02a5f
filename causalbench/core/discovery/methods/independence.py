"""Discovery by a classical independence test of a_k and r_j on D_random, by causal-learn.

`fisher_z` tests the partial correlation given the state and the other actions: it sees linear effects alone. `kci` is
the kernel test on the first `samples`, since its cost is cubic; it conditions on nothing, which is valid since
actions are drawn at random. (Conditioned on the state it found edges where there are none.) An edge is present if its
p-value is below `level`, divided by the number of edges of the stage (Bonferroni). Columns that never vary or repeat
others are left out; D_do is not read. Such tests assume noise: where a simulator has none, what remains of r_j once s
and the other actions are known is rounding, so noise of `JITTER` deviations is added to every term.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.registry import RANDOM, Discoverer, StageProblem
from causalbench.core.discovery.samples.transitions import Samples

JITTER = 0.1  # deviations of the term
STREAM = 102  # beside the numbers of the sets of samples and of the other discoverers


@dataclass(frozen=True)
class FisherZSettings:
    """Own settings of `fisher_z`."""

    level: Annotated[float, Gt(0), Le(1)] = 0.05  # chance of any false edge in a stage


@dataclass(frozen=True)
class KCISettings(FisherZSettings):
    """Own settings of `kci`."""

    samples: Annotated[int, Gt(0)] = 1_000  # most that are used of one stage, since the cost is cubic


def by_fisher_z(problem: StageProblem) -> StageGraph:
    """Fisher's z on the partial correlation."""
    return _discover_stage(problem, "fisherz", problem.settings.training_count)


def by_kci(problem: StageProblem) -> StageGraph:
    """The kernel independence test (Zhang et al. 2011)."""
    return _discover_stage(problem, "kci", problem.options.samples)


def _discover_stage(problem: StageProblem, test: str, count: int) -> StageGraph:
    from causallearn.utils.cit import CIT

    task, stage = problem.task, problem.stage
    terms, n_actions = problem.terms, len(task.actions)
    samples = problem.samples().random.first(count)
    testable = samples.term_scale()[1]
    rewards = noisy_rewards(samples, np.random.default_rng([problem.seed, stage, STREAM]))
    p_value = np.ones((n_actions, len(terms)))
    actions = samples.actions[:, :n_actions]
    states = independent_columns(samples.states.astype(np.float64))
    # Actions first, so that column k is action k.
    table: NDArray[Any] = np.column_stack([actions, states, rewards[:, testable]])
    first_reward = n_actions + states.shape[1]
    independence = CIT(table, test)
    for column, j in enumerate(np.flatnonzero(testable)):
        for k in range(n_actions):
            given = [c for c in range(first_reward) if c != k and test == "fisherz"]
            p_value[k, j] = independence(k, first_reward + column, given)
            problem.report((column * n_actions + k + 1) / (n_actions * testable.sum()), f"{test}: {terms[j]}")
    present = p_value < problem.options.level / p_value.size
    return StageGraph.decided(task, stage, present, testable, {"p_value": p_value})


def noisy_rewards(samples: Samples, rng: np.random.Generator) -> NDArray[np.float64]:
    """Rewards (n, n_terms) in deviations of the term, with noise of `JITTER` of them."""
    return np.asarray(samples.rewards / samples.term_scale()[0] + JITTER * rng.normal(size=samples.rewards.shape))


def independent_columns(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """The columns of `table` (n, m) that vary and are no linear combination of those before them, standardised."""
    scale = table.std(0)
    varying = (table - table.mean(0))[:, scale > 1e-6] / scale[scale > 1e-6]
    kept: list[int] = []
    for column in range(varying.shape[1]):
        if np.linalg.matrix_rank(varying[:, [*kept, column]], tol=1e-3 * np.sqrt(len(table))) > len(kept):
            kept.append(column)
    return varying[:, kept]


EVIDENCE = (
    EvidenceColumn("p_value", "", "chance of so strong a dependence if there were none", main=True,
                   log_range=(1e-4, 1.0)),
)  # fmt: skip
MODULES, EXTRA = ("causallearn",), "causalbench-robotics[causal-learn]"
FISHER_Z = Discoverer(
    "fisher_z",
    by_fisher_z,
    "partial correlation",
    settings=FisherZSettings,
    evidence=EVIDENCE,
    reads=RANDOM,
    modules=MODULES,
    extra=EXTRA,
)
KCI = Discoverer(
    "kci",
    by_kci,
    "kernel independence test",
    settings=KCISettings,
    evidence=EVIDENCE,
    reads=RANDOM,
    modules=MODULES,
    extra=EXTRA,
)
