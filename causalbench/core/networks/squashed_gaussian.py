"""SAC's actor: tanh of a Gaussian whose mean and log std a ReLU MLP gives, as in stable-baselines3."""

from __future__ import annotations

import torch
from torch import Tensor

from causalbench.core.networks.gaussian import LOG_SQRT_2PI
from causalbench.core.networks.stacked import mlp

LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0
TANH_EPSILON = 1e-6  # as in SB3's SquashedDiagGaussianDistribution


def squashed_actor(weights: list[Tensor], obs: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and log std (batch, n_actions) before squashing; `weights` [W1, b1, ...], `obs` (batch, n_obs)."""
    return mean_and_log_std(mlp(weights, obs, "relu"))


def mean_and_log_std(outputs: Tensor) -> tuple[Tensor, Tensor]:
    """Both halves of an actor's outputs (batch, 2 * n_actions), the log std clamped to its bounds."""
    mean, log_std = outputs.chunk(2, -1)
    return mean, log_std.clamp(LOG_STD_MIN, LOG_STD_MAX)


def squashed_sample(mean: Tensor, log_std: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """Action tanh(mean + std * noise) (batch, n_actions) and its log probability (batch,)."""
    action = torch.tanh(mean + log_std.exp() * noise)
    log_prob = -0.5 * noise**2 - log_std - LOG_SQRT_2PI - torch.log(1 - action**2 + TANH_EPSILON)
    return action, log_prob.sum(-1)
