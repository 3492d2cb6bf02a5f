"""Causal action influence (Seitzer, Schoelkopf, Martius 2021), of one action on one reward term.

C(s) = I(r_j; a_k | s, the other actions), the information that a_k has of r_j in one state: from a model of p(r_j |
s, a) alone, whose predictions under new draws of a_k are compared with their mixture, taken as the normal
distribution of the same mean and variance. The paper asks when an agent has influence; an edge is present if the mean
of C over D_inference exceeds `threshold` and `placebo_gate` times the largest placebo's. `cai_high` says how large C
is where it is large. D_do is not read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Gt

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.methods.cmi import CMISettings, gated
from causalbench.core.discovery.registry import OBSERVED, Discoverer, StageProblem
from causalbench.core.discovery.reward_model.settings import PAPER, PAPER_LARGE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from causalbench.core.discovery.reward_model.models import RewardModels
    from causalbench.core.discovery.samples.transitions import Samples

STREAM = 107  # beside the numbers of the sets of samples and of the other discoverers
HIGH = 0.95  # quantile over states


@dataclass(frozen=True)
class CAISettings(CMISettings):
    """Own settings of `cai`."""

    redraws: Annotated[int, Gt(1)] = 16  # of an action, in every state


def discover_stage(problem: StageProblem) -> StageGraph:
    """Fit one model per term with all actions, and ask it what each action alone would change."""
    from causalbench.core.discovery.reward_model.fit import fit_reward_models

    data, own, n_actions = problem.samples(), problem.options, len(problem.task.actions)
    seed, rng = problem.seed + problem.stage, np.random.default_rng([problem.seed, problem.stage, STREAM])
    models = fit_reward_models(
        [data.random], data.random, own, seed, lambda share: problem.report(share, "fitting reward models")
    )
    influence = np.stack(
        [influence_of(k, models, data.inference, own, rng) for k in range(data.random.actions.shape[1])]
    )  # (n_probed, n_terms, n): actions, then placebos
    cai, present = gated(influence.mean(2), n_actions, own)
    evidence = {"cai": cai, "cai_high": np.quantile(influence[:n_actions], HIGH, axis=2)}
    return StageGraph.decided(problem.task, problem.stage, present, data.random.term_scale()[1], evidence)


def influence_of(
    k: int, models: RewardModels, states: Samples, own: CAISettings, rng: np.random.Generator
) -> NDArray[np.float64]:
    """C (n_terms, n) of action k in nats: log deviation of the mixture less the mean log deviation of its parts."""
    actions = np.repeat(states.actions[None], own.redraws, axis=0)
    actions[..., k] = rng.uniform(-1.0, 1.0, actions.shape[:2])
    drawn = [models.predict(replace(states, actions=each), 0) for each in actions]
    mean, log_sigma = (np.stack([part.double().numpy() for part in parts]) for parts in zip(*drawn, strict=True))
    log_sigma = np.maximum(log_sigma, np.log(own.sigma_floor))
    mixture = np.exp(2 * log_sigma).mean(0) + mean.var(0)
    return np.asarray(0.5 * np.log(mixture) - log_sigma.mean(0))


DISCOVERER = Discoverer(
    "cai",
    discover_stage,
    "causal action influence in every state (Seitzer et al. 2021)",
    settings=CAISettings,
    presets={"quick": CAISettings(), "paper": CAISettings(**PAPER), "paper_large": CAISettings(**PAPER_LARGE)},
    evidence=(
        EvidenceColumn("cai", "nats", "information that the action has of the reward, mean over states", main=True,
                       log_range=(1e-4, 2.0)),
        EvidenceColumn("cai_high", "nats", "the same in the state that 95% of all states stay below"),
    ),
    reads=OBSERVED,
)  # fmt: skip
