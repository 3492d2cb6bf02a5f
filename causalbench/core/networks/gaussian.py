"""PPO's networks as plain lists of tensors: a Gaussian actor and one value network with a head per critic.

Same functions and initialisation as stable-baselines3's ActorCriticPolicy: tanh MLPs, orthogonal weights, zero biases,
a log std that does not depend on the state. Weights are [W1, b1, W2, b2, ...]; an actor ends with its log std.
"""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor

from causalbench.core.networks.squashed_gaussian import LOG_SQRT_2PI, last_layer

HIDDEN_GAIN, ACTOR_GAIN, VALUE_GAIN = math.sqrt(2), 0.01, 1.0  # of the orthogonal initialisation, as in SB3


def init_gaussian_actor(
    n_inputs: int, net_arch: tuple[int, ...], n_actions: int, log_std: float, generator: torch.Generator
) -> list[Tensor]:
    """Weights (n_in, n_out) and biases (n_out,) of the mean, then the log std (n_actions,)."""
    return [*_init_mlp((n_inputs, *net_arch, n_actions), ACTOR_GAIN, generator), torch.full((n_actions,), log_std)]


def init_values(n_inputs: int, net_arch: tuple[int, ...], n_heads: int, generator: torch.Generator) -> list[Tensor]:
    """Weights (n_in, n_out) and biases (n_out,) of a value network with `n_heads` outputs."""
    return _init_mlp((n_inputs, *net_arch, n_heads), VALUE_GAIN, generator)


def _init_mlp(sizes: tuple[int, ...], last_gain: float, generator: torch.Generator) -> list[Tensor]:
    weights = []
    for layer, (fan_in, fan_out) in enumerate(pairwise(sizes), 2):
        gain = last_gain if layer == len(sizes) else HIDDEN_GAIN
        kernel = torch.nn.init.orthogonal_(torch.empty(fan_out, fan_in), gain, generator)
        weights += [kernel.T.contiguous(), torch.zeros(fan_out)]
    return weights


def tanh_mlp(weights: list[Tensor], inputs: Tensor) -> Tensor:
    """(batch, n_outputs); `inputs` (batch, n_inputs)."""
    x = inputs
    for kernel, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
        x = torch.addmm(bias, x, kernel).tanh_()
    return last_layer(weights, x)


def gaussian_actor_forward(weights: list[Tensor], obs: Tensor) -> tuple[Tensor, Tensor]:
    """Mean (batch, n_actions) and log std (n_actions,); `obs` (batch, n_obs)."""
    return tanh_mlp(weights[:-1], obs), weights[-1]


def gaussian_log_prob(mean: Tensor, log_std: Tensor, action: Tensor) -> Tensor:
    """(batch, n_actions) log density of every dimension by itself; their sum is the joint one."""
    return -0.5 * ((action - mean) * torch.exp(-log_std)) ** 2 - log_std - LOG_SQRT_2PI
