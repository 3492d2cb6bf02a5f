"""The paper's discoverer: KL between the reward models p(r | s, do(a_k = 0)) and p(r | s, random a_k), Algorithm 2."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import StageGraph, declared_matrix
from causalbench.core.discovery.methods.kl.select import select_causal_actions
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.task import Task

PLACEBO_STREAM = 1000
"""Number, beside seed and stage, of the generator that draws placebos; those of collecting are small."""

if TYPE_CHECKING:
    from causalbench.core.discovery.methods.kl.divergence import Divergence
    from causalbench.core.discovery.registry import StageProblem


def discover_stage(problem: StageProblem) -> StageGraph:
    """Fit the reward models of every (action, term) pair, compare them on D_inference and select."""
    import torch  # here, so that a list of discoverers costs no import of torch

    from causalbench.core.discovery.methods.kl.divergence import Divergence, divergence
    from causalbench.core.discovery.methods.kl.placebos import placebo_copy
    from causalbench.core.discovery.methods.kl.reward_model import train_reward_models

    data, settings, n_actions = problem.samples(), problem.settings, len(problem.task.actions)
    training = [(data.random, do) for do in data.interventions]
    if data.extra is not None:
        rng = np.random.default_rng([problem.seed, problem.stage, PLACEBO_STREAM])
        for _ in range(settings.placebo_sets):
            random, extra = (placebo_copy(s, n_actions, rng) for s in (data.random, data.extra))
            training.append((random, extra))
    models = train_reward_models(
        training,
        settings,
        problem.seed + problem.stage,
        lambda share: problem.report(share, "fitting reward models"),
    )
    inference = data.inference

    def probe(model: int, action: int) -> Divergence:
        without = models.predict(inference.without(action), model)
        return divergence(*without, *models.predict(inference, model), settings.sigma_kl)

    def probe_all(pairs: list[tuple[int, int]]) -> Divergence:
        return Divergence(*(torch.stack(column) for column in zip(*(probe(*pair) for pair in pairs), strict=True)))

    kl = probe_all([(k, k) for k in range(n_actions)])
    null_kl = None
    if settings.n_placebos:
        placebos = range(n_actions, n_actions + settings.n_placebos)
        nulls = probe_all([(model, p) for model in range(n_actions, len(training)) for p in placebos])
        null_kl = np.asarray(getattr(nulls, settings.direction)).clip(min=0.0)
    return _select(problem.task, problem.stage, kl, null_kl, data.random.term_scale()[1], settings)


def _select(
    task: Task,
    stage: int,
    kl: Divergence,
    null_kl: NDArray[np.float64] | None,
    testable: NDArray[np.bool_],
    settings: DiscoverySettings,
) -> StageGraph:
    """Algorithm 2 on every term, then the placebo gate; `kl` is (n_actions, n_terms), `null_kl` (n_nulls, n_terms)."""
    terms = task.stage_terms(stage, discoverable_only=True)
    used = np.asarray(getattr(kl, settings.direction)).clip(min=0.0)
    matrix = declared_matrix(task, stage, terms)
    cv, normalised = np.zeros(len(terms)), np.zeros((len(task.actions), len(terms)))
    largest_null = None if null_kl is None else null_kl.max(0)
    for j in range(len(terms)):
        choice = select_causal_actions(
            used[:, j], settings.epsilon_cv, settings.epsilon_normalize, settings.epsilon_direct
        )
        cv[j], normalised[:, j] = choice.cv, choice.normalised
        if testable[j]:
            matrix[:, j] = choice.selected
            if largest_null is not None:
                matrix[:, j] &= used[:, j] > settings.placebo_gate * largest_null[j]
    forward, reverse, symmetric = map(np.asarray, kl)
    return StageGraph(
        stage, task.actions, terms, matrix, forward, reverse, symmetric, normalised,
        null_kl=null_kl, cv=cv, testable=testable,
    )  # fmt: skip
