"""Discovery by a holdout randomisation test on random samples (Candes et al. 2018; Tansey et al. 2022).

Actions are drawn by us, independently of the state and of one another, so what a_k could have been instead is known. On
two thirds of the sequences a model of the mean and of the spread of every term is fitted; on the rest its loss is
compared with that after a_k was drawn anew. If a_k causes nothing, either draw is as good, so that the sign of the
difference is a fair coin, whatever the model. The e-value of that coin decides (`betting.positive`), the mean over
several redraws. No snapshots, no interventions, no placebos; a poor model costs power alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.methods.anytime import betting
from causalbench.core.discovery.registry import RANDOM, Discoverer, StageProblem
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.errors import UndecidedStageError, UserError

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingRegressor

Array = NDArray[np.float64]

STREAM = 105  # beside the numbers of the sets of samples and of the other discoverers
TRAINED_ON = 2 / 3  # share of the sequences
LEAST_SPREAD = 0.05  # deviations of the term: a model of a deterministic term is surer than its data


@dataclass(frozen=True)
class HRTSettings:
    """Own settings of `hrt`."""

    level: Annotated[float, Gt(0), Le(1)] = 0.05  # chance of any false edge in a stage
    redraws: Annotated[int, Gt(0)] = 8  # of an action, whose e-values are averaged


def discover_stage(problem: StageProblem) -> StageGraph:
    """Test every edge of one stage on D_random; present is what is significant at `level`, divided by all edges."""
    own = problem.options
    testable = problem.samples().random.term_scale()[1]
    log_e = evidence_of(problem, own.redraws)
    present = log_e > math.log(log_e.size / own.level)
    return StageGraph.decided(problem.task, problem.stage, present, testable, {"log_e": log_e})


def evidence_of(problem: StageProblem, redraws: int) -> Array:
    """(n_actions, n_terms) log e-values against the hypothesis that a_k causes nothing of r_j, given the rest."""
    samples, n_actions = problem.samples().random, len(problem.task.actions)
    scale, testable = samples.term_scale()
    rng = np.random.default_rng([problem.seed, problem.stage, STREAM])
    train = np.isin(samples.sequence, _training_sequences(samples, rng))
    if train.all() or not train.any():
        raise UndecidedStageError("one sequence of samples cannot be both learned from and tested on")
    inputs = np.column_stack([samples.actions[:, :n_actions], samples.states]).astype(np.float64)
    log_e = np.zeros((n_actions, len(problem.terms)))
    for j in np.flatnonzero(testable):
        rewards = samples.rewards[:, j].astype(np.float64)
        rewards = (rewards - rewards[train].mean()) / scale[j]
        model = _Model(inputs[train], rewards[train], problem.seed)
        for k in range(n_actions):
            log_e[k, j] = _log_e(model, inputs[~train], rewards[~train], k, redraws, rng)
        problem.report((j + 1) / len(problem.terms), f"testing {problem.terms[j]}")
    return log_e


def _log_e(model: _Model, inputs: Array, rewards: Array, action: int, redraws: int, rng: np.random.Generator) -> float:
    """Log of the mean e-value of `redraws` new draws of one action."""
    loss, logs = model.loss(inputs, rewards), []
    for _ in range(redraws):
        other = inputs.copy()
        other[:, action] = rng.uniform(-1.0, 1.0, len(other))
        logs.append(float(betting.positive(model.loss(other, rewards) - loss)))
    return float(np.logaddexp.reduce(logs) - math.log(redraws))


def _training_sequences(samples: Samples, rng: np.random.Generator) -> NDArray[np.int32]:
    sequences = rng.permutation(np.unique(samples.sequence))
    return sequences[: round(TRAINED_ON * len(sequences))]


class _Model:
    """Boosted trees of the mean, and of the logarithm of the squared rest."""

    def __init__(self, inputs: Array, rewards: Array, seed: int) -> None:
        self.mean = _boosted(seed).fit(inputs, rewards)
        rest = np.log((rewards - self.mean.predict(inputs)) ** 2 + LEAST_SPREAD**2)
        self.spread = _boosted(seed + 1).fit(inputs, rest)

    def loss(self, inputs: Array, rewards: Array) -> Array:
        """(n,) negative log likelihood of normal rewards, up to a constant."""
        log_variance = self.spread.predict(inputs)
        return np.asarray((rewards - self.mean.predict(inputs)) ** 2 / np.exp(log_variance) + log_variance)


def _boosted(seed: int) -> HistGradientBoostingRegressor:
    try:
        from sklearn.ensemble import HistGradientBoostingRegressor  # takes a second to import
    except ImportError as error:
        raise UserError(f"tests of random samples need scikit-learn: pip install '{EXTRA}'") from error
    return HistGradientBoostingRegressor(max_iter=80, max_leaf_nodes=15, learning_rate=0.1, random_state=seed)


EXTRA = "causalbench-robotics[causal-learn]"
DISCOVERER = Discoverer(
    "hrt",
    discover_stage,
    "holdout randomisation test on random samples",
    settings=HRTSettings,
    evidence=(
        EvidenceColumn("log_e", "nats", "log of the e-value against the hypothesis that the action is no cause",
                       main=True),
    ),
    reads=RANDOM,
    modules=("sklearn",),
    extra=EXTRA,
)  # fmt: skip
