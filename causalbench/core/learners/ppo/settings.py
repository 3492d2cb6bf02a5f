"""Every number that proximal policy optimisation needs, with the paper's values beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from causalbench.core.learners.settings import StagedSettings


@dataclass(frozen=True)
class PPOSettings(StagedSettings):
    """Settings of the learner `PPO`, for the agent of each stage. Most defaults are those of stable-baselines3."""

    net_arch: tuple[Annotated[int, Gt(0)], ...] = (64, 64)  # units of each hidden layer, of actor and critics
    n_steps: Annotated[int, Gt(0)] = 1_024  # env steps in an epoch, of all worlds together (Algorithm 3, `n_step`)
    n_epochs: Annotated[int, Gt(0)] = 10  # passes over an epoch's samples
    batch_size: Annotated[int, Gt(0)] = 64  # a stage with fewer samples waits for the next epoch
    learning_rate: Annotated[float, Gt(0)] = 3e-4  # of Adam
    decay_steps: Annotated[int, Ge(0)] = 0  # steps in which the rate falls to 0, linearly; 0: it stays constant
    gamma: Annotated[float, Gt(0), Le(1)] = 0.99  # discount of a control step
    gae_lambda: Annotated[float, Ge(0), Le(1)] = 0.95  # of generalised advantage estimation
    clip_range: Annotated[float, Gt(0)] = 0.2  # how far a probability ratio may move from 1
    target_kl: Annotated[float, Gt(0)] = 0.03  # an epoch's training stops when the policy moved 1.5 times as far
    advantage_floor: Annotated[float, Ge(0)] = 0.1  # smallest divisor of an advantage, in mean deviations
    ent_coef: Annotated[float, Ge(0)] = 0.0  # weight of the entropy bonus
    vf_coef: Annotated[float, Ge(0)] = 0.5  # weight of the value loss
    max_grad_norm: Annotated[float, Gt(0)] = 0.5  # longer gradients are shortened to this length
    log_std_init: float = -0.5  # SB3's 0.0 puts a third of all first actions on their bounds
    critics: Literal["rows", "terms"] = "rows"  # one value head for each distinct row, or term
    engine: Literal["fused", "autograd"] = "fused"  # makes the gradients: written out, or by autograd


PRESETS: Mapping[str, PPOSettings] = {
    "quick": PPOSettings(),
    "paper": PPOSettings(n_steps=10_000, learning_rate=5e-5, observe_gripper=False, features=False),
}
"""Name -> starting point; the paper's is its hyperparameter table (64-64, batches of 64, 10 passes, discount 0.99, clip
range 0.2)."""
