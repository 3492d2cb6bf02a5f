"""Every number a learner or an evaluation needs, in one place, with the paper's values beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class SACSettings:
    """Settings of `StagedSAC`, per stage agent. The defaults are the quick tier's; `PRESETS["paper"]` the paper's."""

    net_arch: tuple[int, ...] = (64, 64)
    batch_size: int = 256
    learning_rate: float = 1e-3
    gamma: float = 0.99
    tau: float = 0.005  # soft target update factor
    buffer_size: int = 10_000  # samples kept per stage
    learning_starts: int = 500  # random samples per stage before its first update
    train_every: int = 32  # new samples of a stage that trigger its training (Algorithm 3, `count`)
    updates_per_sample: float = 0.25
    ent_coef_init: float = 0.05  # entropy start; SB3's "auto" starts at 1.0
    cooperation_weight: float = 0.3  # share of the next stage's critic in cSAC
    critics: Literal["rows", "heads", "terms"] = "rows"  # a critic per distinct matrix row (heads: of one net) or term
    n_envs: int = 1  # scenes stepped by one learner
    observe_gripper: bool = True  # ours; the paper's observation has no gripper opening
    observation: Literal["state", "paper"] = "state"  # "paper": image or LiDAR, too, through the paper's convolutions


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


LearnerSettings = SACSettings | PPOSettings


@dataclass(frozen=True)
class EvaluationSettings:
    """When and how a learner is evaluated: full task episodes from stage 1 on seeds of their own."""

    every: int = 2_000  # env steps between evaluations
    episodes: int = 20  # per evaluation, deterministic and sampled each
    final_episodes: int = 50  # after the last step

    def episodes_due(self, before: int, taken: int, env_steps: int) -> int:
        """Episodes of the evaluation that the steps from `before` to `taken` of `env_steps` make due; 0 if none."""
        if taken >= env_steps:
            return self.final_episodes
        return self.episodes if taken // self.every > before // self.every else 0


PRESETS: Mapping[str, Mapping[str, LearnerSettings]] = {
    "SAC": {
        "quick": SACSettings(),
        "paper": SACSettings(
            net_arch=(512, 512),
            batch_size=512,
            learning_rate=5e-4,
            train_every=1000,
            updates_per_sample=1.0,
            learning_starts=1000,
            critics="heads",  # the paper does not say; networks of their own make an update cost 1.9 times as much
            observe_gripper=False,
        ),
    },
    "PPO": {
        "quick": PPOSettings(),
        "paper": PPOSettings(n_steps=10_000, learning_rate=5e-5, observe_gripper=False),
    },
}
"""Learner -> name -> starting point; the paper's are its hyperparameter table and its section Neural Network
Architecture (PPO there: 64-64, batches of 64, 10 passes, discount 0.99, clip range 0.2)."""
