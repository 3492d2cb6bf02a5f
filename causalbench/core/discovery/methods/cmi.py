"""Discovery by conditional mutual information, after CausalMoMa (Hu, Stone, Martin-Martin 2023).

CMI(a_k; r_j | s, a without a_k) = E[log p(r_j | s, a) - log p(r_j | s, a without a_k)], both models fitted on D_random
alone and judged on D_inference; an action is a cause if it exceeds `cmi_threshold` and `placebo_gate` times the
largest placebo's. The models, the floor of their deviation and the placebos are those of `kl`, for the same reasons.
D_do is not read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from causalbench.core.discovery.graph import StageGraph, declared_matrix
from causalbench.core.discovery.methods.kl.reward_model import fit_reward_models, scaled_rewards

if TYPE_CHECKING:
    from causalbench.core.discovery.registry import StageProblem


def discover_stage(problem: StageProblem) -> StageGraph:
    """Fit one model per term with all actions and one without each action, and compare their likelihoods."""
    task, stage, settings = problem.task, problem.stage, problem.settings
    terms, n_actions = task.stage_terms(stage, discoverable_only=True), len(task.actions)
    data = problem.samples()
    random, inference = data.random, data.inference
    n_probed = random.actions.shape[1]  # actions, then placebos
    models = fit_reward_models(
        [*(random.without(k) for k in range(n_probed)), random],
        random,
        settings,
        problem.seed + stage,
        lambda share: problem.report(share, "fitting reward models"),
    )
    target = torch.from_numpy(scaled_rewards(inference, random)).T.double()  # (n_terms, n)

    def likelihood(mean: Tensor, log_sigma: Tensor) -> Tensor:
        sigma = log_sigma.double().exp().clamp_min(settings.sigma_kl)
        return (-0.5 * ((target - mean.double()) / sigma) ** 2 - sigma.log()).mean(-1)

    full = likelihood(*models.predict(inference, n_probed))
    without = torch.stack([likelihood(*models.predict(inference.without(k), k)) for k in range(n_probed)])
    cmi, placebo = np.split(np.asarray(full - without), [n_actions])
    least = np.fmax(settings.cmi_threshold, settings.placebo_gate * placebo.max(0, initial=0.0))
    testable = random.term_scale()[1]
    matrix = np.where(testable, cmi > least, declared_matrix(task, stage, terms))
    return StageGraph(stage, task.actions, terms, matrix, testable=testable, evidence={"cmi": cmi})
