"""Discovery by a permutation test on paired interventions: does setting a_k to 0 change r_j at all?

In every visited state the drawn action is taken, taken again, and taken with each a_k at 0. If a_k causes nothing, its
difference from the first and the repetition's can be exchanged, so the sum over states of D_k^2 - D_repeat^2 is
compared with that under random signs. An edge is present if its one-sided p-value is below `level`, divided by the
number of edges of the stage (Bonferroni). Where restoring is exact a repetition changes nothing, and the test asks only
whether a few states showed any effect, however small: significance, where `paired` judges size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.registry import NO_SAMPLES, Discoverer, StageProblem
from causalbench.core.discovery.samples.transitions import varies
from causalbench.errors import UndecidedStageError

STREAM = 101  # beside the numbers of the sets of samples and of `paired`
FLIPS = 5_000
ROUNDING = 1e-12  # variances of the term: a difference of a millionth of a deviation is arithmetic, no effect


@dataclass(frozen=True)
class PermutationSettings:
    """Own settings of `permutation`."""

    states: Annotated[int, Gt(0)] = 100  # of one stage in which actions are compared
    level: Annotated[float, Gt(0), Le(1)] = 0.05  # chance of any false edge in a stage


def discover_stage(problem: StageProblem) -> StageGraph:
    """Test every edge of one stage on `states` states; each takes (n_actions + 2) actions."""
    task, stage, own = problem.task, problem.stage, problem.options
    rng = np.random.default_rng([problem.seed, stage, STREAM])
    walk = problem.walk(rng)
    rewards = []
    for n in range(own.states):
        rewards.append(walk.compare())
        problem.report((n + 1) / own.states, "paired interventions")
    values = np.array(rewards)  # (n, n_actions + 2, n_terms)
    finite = np.isfinite(values).all((1, 2))
    if finite.mean() < 0.5:
        raise UndecidedStageError(f"{(~finite).sum()} of {len(values)} states were not finite")
    values = values[finite]
    squares, variance = (values[:, 1:] - values[:, :1]) ** 2, values[:, 0].var(0)
    squares[squares < ROUNDING * variance] = 0.0
    p_value = sign_flip_p_values(squares[:, 1:] - squares[:, :1], rng)
    testable = varies(values[:, 0])
    return StageGraph.decided(task, stage, p_value < own.level / p_value.size, testable, {"p_value": p_value})


def sign_flip_p_values(difference: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """One-sided p-values (...) of `difference` (n, ...) being symmetric about 0 in each of n independent rows."""
    rows = difference.reshape(len(difference), -1)
    signs = rng.choice([-1.0, 1.0], (FLIPS, len(rows)))
    tolerance = 1e-9 * np.abs(rows).sum(0)  # sums of the same numbers in another order
    reached = signs @ rows >= rows.sum(0) - tolerance
    return ((1 + reached.sum(0)) / (1 + FLIPS)).reshape(difference.shape[1:])


DISCOVERER = Discoverer(
    "permutation",
    discover_stage,
    "permutation test on paired interventions",
    settings=PermutationSettings,
    evidence=(
        EvidenceColumn("p_value", "", "chance of so large a difference from 0 under random signs", main=True,
                       log_range=(1e-4, 1.0)),
    ),
    reads=NO_SAMPLES,
)  # fmt: skip
