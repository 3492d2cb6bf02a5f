"""Causal weights as ACE estimates them (Ji et al. 2024): a linear model of every reward, pruned by the adaptive lasso.

ACE fits DirectLiNGAM to states, actions and the reward and reads off the weight of each action. Which comes before
which is known here, actions and state before rewards, and what is left of DirectLiNGAM then is its last step: least
squares, then a lasso whose penalties are the inverse of those coefficients, at the strength of the best BIC. An edge
is present if its weight is not 0. Linear effects alone are seen. D_do is not read. Noise of `JITTER` deviations is
added to every term, as for `fisher_z`, since a simulator has none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.methods.independence import EXTRA, independent_columns, noisy_rewards
from causalbench.core.discovery.registry import RANDOM, Discoverer, StageProblem

Array = NDArray[np.float64]

STREAM = 108  # beside the numbers of the sets of samples and of the other discoverers


def discover_stage(problem: StageProblem) -> StageGraph:
    """Weigh every edge of one stage on D_random."""
    samples, n_actions = problem.samples().random, len(problem.task.actions)
    testable = samples.term_scale()[1]
    rewards = noisy_rewards(samples, np.random.default_rng([problem.seed, problem.stage, STREAM]))
    states = independent_columns(samples.states.astype(np.float64))
    inputs = np.column_stack([samples.actions[:, :n_actions].astype(np.float64), states])
    weight = np.zeros((n_actions, len(problem.terms)))
    for j in np.flatnonzero(testable):
        weight[:, j] = adaptive_lasso(inputs, rewards[:, j])[:n_actions]
        problem.report((j + 1) / len(problem.terms), f"weighing {problem.terms[j]}")
    return StageGraph.decided(problem.task, problem.stage, weight != 0.0, testable, {"weight": weight})


def adaptive_lasso(inputs: Array, target: Array) -> Array:
    """Coefficients (d,) of `inputs` (n, d) for `target` (n,), 0 where BIC is better without."""
    from sklearn.linear_model import LassoLarsIC, LinearRegression

    penalty = np.abs(LinearRegression().fit(inputs, target).coef_)
    return np.asarray(LassoLarsIC(criterion="bic").fit(inputs * penalty, target).coef_ * penalty)


DISCOVERER = Discoverer(
    "ace",
    discover_stage,
    "causal weights of a linear model, pruned by the adaptive lasso (ACE)",
    evidence=(
        EvidenceColumn("weight", "deviations", "change of the reward per unit of the action; 0: pruned", main=True),
    ),
    reads=RANDOM,
    modules=("sklearn",),
    extra=EXTRA,
)  # fmt: skip
