"""PPO's actor: a Gaussian of a tanh MLP's mean and a log std that does not depend on the state, as in SB3."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from causalbench.core.networks.stacked import mlp

LOG_SQRT_2PI = 0.5 * math.log(2 * math.pi)


def gaussian_actor(weights: list[Tensor], obs: Tensor) -> tuple[Tensor, Tensor]:
    """Mean (batch, n_actions) and log std (n_actions,); `weights` [W1, b1, ..., log std], `obs` (batch, n_obs)."""
    return mlp(weights[:-1], obs, "tanh"), weights[-1]


def gaussian_log_prob(mean: Tensor, log_std: Tensor, action: Tensor) -> Tensor:
    """(batch, n_actions) log density of every dimension by itself; their sum is the joint one."""
    return -0.5 * ((action - mean) * torch.exp(-log_std)) ** 2 - log_std - LOG_SQRT_2PI
