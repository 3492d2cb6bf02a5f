"""The paper's discoverer: KL between the reward models p(r | s, do(a_k = 0)) and p(r | s, random a_k), Algorithm 2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import StageGraph, declared_matrix
from causalbench.core.discovery.select import select_causal_actions
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.task import Task

if TYPE_CHECKING:
    from causalbench.core.discovery.discoverers import StageProblem
    from causalbench.core.discovery.divergence import Divergence


def discover_stage(problem: StageProblem) -> StageGraph:
    """Fit the reward models of every (action, term) pair, compare them on D_inference and select."""
    import torch  # here, so that a list of discoverers costs no import of torch

    from causalbench.core.discovery.divergence import Divergence, divergence
    from causalbench.core.discovery.reward_model import train_reward_models

    data, settings = problem.samples(), problem.settings
    models = train_reward_models(
        data.random,
        data.interventions,
        settings,
        problem.seed + problem.stage,
        lambda share: problem.report(share, "fitting reward models"),
    )
    inference = data.inference
    pairs = [
        divergence(*models.predict(inference.without(k), k), *models.predict(inference, k), settings.sigma_kl)
        for k in range(len(data.interventions))
    ]
    kl = Divergence(*(torch.stack(column) for column in zip(*pairs, strict=True)))
    return _select(problem.task, problem.stage, kl, data.random.term_scale()[1], settings)


def _select(
    task: Task, stage: int, kl: Divergence, testable: NDArray[np.bool_], settings: DiscoverySettings
) -> StageGraph:
    """Algorithm 2 on every term, then the placebo gate; `kl` is (n_actions + n_placebos, n_terms)."""
    terms = task.stage_terms(stage, discoverable_only=True)
    k = len(task.actions)
    used = np.asarray(getattr(kl, settings.direction)).clip(min=0.0)
    matrix = declared_matrix(task, stage, terms)
    cv, normalised = np.zeros(len(terms)), np.zeros((k, len(terms)))
    placebo = used[k:].max(0) if settings.n_placebos else None
    for j in range(len(terms)):
        choice = select_causal_actions(
            used[:k, j], settings.epsilon_cv, settings.epsilon_normalize, settings.epsilon_direct
        )
        cv[j], normalised[:, j] = choice.cv, choice.normalised
        if testable[j]:
            matrix[:, j] = choice.selected
            if placebo is not None:
                matrix[:, j] &= used[:k, j] > settings.placebo_gate * placebo[j]
    forward, reverse, symmetric = (np.asarray(values)[:k] for values in kl)
    return StageGraph(
        stage, task.actions, terms, matrix, forward, reverse, symmetric, normalised, cv, placebo, testable
    )
