"""Every number that proximal policy optimisation needs, with the paper's values beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class PPOSettings:
    """Settings of `StagedPPO`, per stage agent. The defaults are the quick tier's; most are stable-baselines3's."""

    net_arch: tuple[int, ...] = (64, 64)
    n_steps: int = 1_024  # env steps in an epoch, of all worlds together (Algorithm 3, `n_step`)
    n_epochs: int = 10  # passes over an epoch's samples
    batch_size: int = 64  # also the fewest samples a stage trains on; fewer wait for the next epoch
    learning_rate: float = 3e-4
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    target_kl: float = 0.03  # training stops once the joint policy has moved 1.5 times as far
    advantage_floor: float = 0.1  # least deviation that divides an action's advantage, in units of the mean of all
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    log_std_init: float = -0.5  # SB3's 0.0 puts a third of all first actions on their bounds
    critics: Literal["rows", "terms"] = "rows"  # one value head per distinct matrix row, or per reward term
    n_envs: int = 1  # scenes stepped by one learner
    observe_gripper: bool = True  # ours; the paper's observation has no gripper opening
    observation: Literal["state", "paper"] = "state"  # "paper": image or LiDAR, too, through the paper's convolutions


PRESETS: Mapping[str, PPOSettings] = {
    "quick": PPOSettings(),
    "paper": PPOSettings(n_steps=10_000, learning_rate=5e-5, observe_gripper=False),
}
"""Name -> starting point; the paper's is its hyperparameter table (64-64, batches of 64, 10 passes, discount 0.99, clip
range 0.2)."""
