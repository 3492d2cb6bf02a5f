"""SAC's networks as plain lists of tensors: a squashed Gaussian actor, and the initial weights of its critics.

Same functions and initialisation as stable-baselines3's SAC (ReLU MLPs, log std clamped to [-20, 2]); lists of tensors,
since all critics of an agent, twins included, run side by side (`stacked_mlp`). Weights are [W1, b1, W2, b2, ...].
"""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor

LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0
TANH_EPSILON = 1e-6  # as in SB3's SquashedDiagGaussianDistribution
LOG_SQRT_2PI = 0.5 * math.log(2 * math.pi)


def init_actor(n_inputs: int, net_arch: tuple[int, ...], n_actions: int, generator: torch.Generator) -> list[Tensor]:
    """Weights (n_in, n_out) and biases (n_out,) of an actor whose last layer is [mean, log std]."""
    return [w[0] for w in init_critics(1, n_inputs, net_arch, 2 * n_actions, generator)]


def init_critics(
    count: int, n_inputs: int, net_arch: tuple[int, ...], n_outputs: int, generator: torch.Generator
) -> list[Tensor]:
    """Weights (count, n_in, n_out) and biases (count, n_out) with torch.nn.Linear's initialisation."""
    weights = []
    sizes = (n_inputs, *net_arch, n_outputs)
    for fan_in, fan_out in pairwise(sizes):
        bound = 1 / math.sqrt(fan_in)
        for shape in ((count, fan_in, fan_out), (count, fan_out)):
            weights.append((torch.rand(shape, generator=generator) * 2 - 1) * bound)
    return weights


def actor_forward(weights: list[Tensor], obs: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and log std (batch, n_actions) of the Gaussian before squashing; `obs` (batch, n_obs)."""
    x = obs
    for kernel, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
        x = torch.addmm(bias, x, kernel).relu_()
    mean, log_std = last_layer(weights, x).chunk(2, -1)
    return mean, log_std.clamp(LOG_STD_MIN, LOG_STD_MAX)


def last_layer(weights: list[Tensor], x: Tensor) -> Tensor:
    """(batch, n_out) of x (batch, n_in); rounded the same however the kernel lies in memory."""
    kernel, bias = weights[-2:]
    return torch.addmm(bias[:, None], kernel.T.contiguous(), x.T).T


def squashed_sample(mean: Tensor, log_std: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """Action tanh(mean + std * noise) (batch, n_actions) and its log probability (batch,)."""
    action = torch.tanh(mean + log_std.exp() * noise)
    log_prob = -0.5 * noise**2 - log_std - LOG_SQRT_2PI - torch.log(1 - action**2 + TANH_EPSILON)
    return action, log_prob.sum(-1)
