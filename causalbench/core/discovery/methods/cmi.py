"""Discovery by conditional mutual information, after CausalMoMa (Hu, Stone, Martin-Martin 2023).

CMI(a_k; r_j | s, a without a_k) = E[log p(r_j | s, a) - log p(r_j | s, a without a_k)], both models fitted on D_random
alone and judged on D_inference; an action is a cause if it exceeds `threshold` and `placebo_gate` times the largest
placebo's. The models, the floor of their deviation and the placebos are those of the paper's discoverer, for the same
reasons. D_do is not read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.registry import OBSERVED, Discoverer, StageProblem
from causalbench.core.discovery.reward_model.settings import PAPER, PAPER_LARGE, RewardModelSettings

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from causalbench.core.discovery.reward_model.models import RewardModels
    from causalbench.core.discovery.samples.transitions import Samples


@dataclass(frozen=True)
class CMISettings(RewardModelSettings):
    """Own settings of `cmi`."""

    threshold: Annotated[float, Ge(0)] = 0.02  # least conditional mutual information of a cause, in nats
    sigma_floor: Annotated[float, Ge(0)] = 0.2  # of a model when its likelihood is judged, in deviations of the term
    placebo_gate: Annotated[float, Ge(0)] = 3.0  # an action counts only above this times the largest placebo's


def discover_stage(problem: StageProblem) -> StageGraph:
    """Fit one model per term with all actions and one without each action, and compare their likelihoods."""
    from causalbench.core.discovery.reward_model.fit import fit_reward_models

    data, own = problem.samples(), problem.options
    random, n_probed = data.random, data.random.actions.shape[1]  # actions, then placebos
    models = fit_reward_models(
        [*(random.without(k) for k in range(n_probed)), random],
        random,
        own,
        problem.seed + problem.stage,
        lambda share: problem.report(share, "fitting reward models"),
    )
    information = _information(models, random, data.inference, own.sigma_floor)
    cmi, present = gated(information, len(problem.task.actions), own)
    return StageGraph.decided(problem.task, problem.stage, present, random.term_scale()[1], {"cmi": cmi})


def gated(
    information: NDArray[np.float64], n_actions: int, own: CMISettings
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """That of the actions (n_actions, n_terms), and which of it is enough for a cause; after them come placebos."""
    actions, placebo = np.split(information, [n_actions])
    least = np.fmax(own.threshold, own.placebo_gate * placebo.max(0, initial=0.0))
    return actions, actions > least


def _information(models: RewardModels, random: Samples, inference: Samples, sigma_floor: float) -> NDArray[np.float64]:
    """(n_probed, n_terms) what every action, or placebo, adds to the mean log likelihood of each term, nats."""
    import torch  # here, so that a list of discoverers costs no import of torch

    from causalbench.core.discovery.reward_model.models import scaled_rewards

    target = torch.from_numpy(scaled_rewards(inference, random)).T.double()  # (n_terms, n)

    def likelihood(mean: Tensor, log_sigma: Tensor) -> Tensor:
        sigma = log_sigma.double().exp().clamp_min(sigma_floor)
        return (-0.5 * ((target - mean.double()) / sigma) ** 2 - sigma.log()).mean(-1)

    n_probed = random.actions.shape[1]
    full = likelihood(*models.predict(inference, n_probed))
    without = [likelihood(*models.predict(inference.without(k), k)) for k in range(n_probed)]
    return np.asarray(full - torch.stack(without))


DISCOVERER = Discoverer(
    "cmi",
    discover_stage,
    "conditional mutual information (CausalMoMa)",
    settings=CMISettings,
    presets={"quick": CMISettings(), "paper": CMISettings(**PAPER), "paper_large": CMISettings(**PAPER_LARGE)},
    evidence=(
        EvidenceColumn("cmi", "nats", "conditional mutual information of action and reward", main=True,
                       log_range=(1e-4, 2.0)),
    ),
    reads=OBSERVED,
)  # fmt: skip
