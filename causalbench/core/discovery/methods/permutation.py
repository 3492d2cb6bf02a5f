"""Discovery by a permutation test on paired interventions: does setting a_k to 0 change r_j at all?

In every visited state the drawn action is taken, taken again, and taken with each a_k at 0. If a_k causes nothing, its
difference from the first and the repetition's can be exchanged, so the sum over states of D_k^2 - D_repeat^2 is
compared with that under random signs. An edge is present if its one-sided p-value is below `level`, divided by the
number of edges of the stage (Bonferroni). Where restoring is exact a repetition changes nothing, and there is nothing
to test: one difference that is more than rounding is proof, however small the effect and however rare. `moved` counts
them. That is significance, where `paired` judges size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.registry import NO_SAMPLES, Discoverer, StageProblem
from causalbench.core.discovery.samples.transitions import Samples, varies
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
    rewards, visited = [], []
    for n in range(own.states):
        rewards.append(walk.compare())
        visited.append((walk.model_inputs(), walk.drawn, walk.sequence))
        problem.report((n + 1) / own.states, "paired interventions")
    values = np.array(rewards)  # (n, n_actions + 2, n_terms)
    finite = np.isfinite(values).all((1, 2))
    if finite.mean() < 0.5:
        raise UndecidedStageError(f"{(~finite).sum()} of {len(values)} states were not finite")
    values = values[finite]
    squares, variance = (values[:, 1:] - values[:, :1]) ** 2, values[:, 0].var(0)
    squares[squares < ROUNDING * variance] = 0.0
    moved = (squares[:, 1:] > squares[:, :1]).sum(0).astype(np.float64)
    p_value = sign_flip_p_values(squares[:, 1:] - squares[:, :1], rng)
    if walk.exact:
        p_value = np.where(moved > 0, 0.0, 1.0)
    problem.keep("compared", _samples(values, visited, finite))
    present, evidence = p_value < own.level / p_value.size, {"p_value": p_value, "moved": moved}
    return StageGraph.decided(task, stage, present, varies(values[:, 0]), evidence)


def _samples(
    values: NDArray[np.float64], visited: list[tuple[NDArray[np.float32], NDArray[np.float64], int]], kept: NDArray[Any]
) -> Samples:
    """Every step that was taken: of each state the drawn action, it again, and it with each action at 0."""
    states, actions, sequence = (np.array(column)[kept] for column in zip(*visited, strict=True))
    n_tries, n_actions = values.shape[1], actions.shape[1]
    tried = np.repeat(actions[:, None], n_tries, axis=1)
    tried[:, np.arange(2, n_tries), np.arange(n_actions)] = 0.0
    return Samples(
        np.repeat(states, n_tries, axis=0).astype(np.float32),
        tried.reshape(-1, n_actions).astype(np.float32),
        values.reshape(-1, values.shape[2]).astype(np.float32),
        np.repeat(sequence, n_tries).astype(np.int32),
        len(kept) * n_tries,
        int((~kept).sum()) * n_tries,
    )


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
        EvidenceColumn("p_value", "", "chance of so large a difference from 0 under random signs; 0 where restoring is "
                       "exact and there is any", main=True, log_range=(1e-4, 1.0)),
        EvidenceColumn("moved", "states", "states in which the action at 0 changed the reward more than a repetition"),
    ),
    reads=NO_SAMPLES,
)  # fmt: skip
