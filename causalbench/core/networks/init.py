"""Initial weights of every network: torch's own for SAC, reward models and convolutions, orthogonal ones for PPO.

Layers come in one order everywhere, [W1, b1, W2, b2, ...], and draw in that order. Kernels of fully connected layers
are (n_in, n_out), behind a leading dimension for networks side by side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor

HIDDEN_GAIN = math.sqrt(2)  # of PPO's orthogonal kernels, as in stable-baselines3


def uniform_layer(
    kernel: Sequence[int], bias: Sequence[int], fan_in: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Kernel and bias of the given shapes, uniform in +-1 / sqrt(fan_in): torch.nn.Linear's and torch.nn.Conv's own."""
    bound = 1 / math.sqrt(fan_in)
    w, b = ((torch.rand(*shape, generator=generator) * 2 - 1) * bound for shape in (kernel, bias))
    return w, b


def uniform_mlp(count: int, sizes: Sequence[int], generator: torch.Generator) -> list[Tensor]:
    """Kernels (count, n_in, n_out) and biases (count, n_out) of `count` MLPs with layers of the given sizes."""
    layers = [uniform_layer((count, a, b), (count, b), a, generator) for a, b in pairwise(sizes)]
    return [w for layer in layers for w in layer]


def orthogonal_mlp(sizes: Sequence[int], last_gain: float, generator: torch.Generator) -> list[Tensor]:
    """Orthogonal kernels (1, n_in, n_out) and zero biases (1, n_out) of one MLP, as in stable-baselines3's PPO."""
    weights = list[Tensor]()
    for layer, (n_in, n_out) in enumerate(pairwise(sizes), 2):
        gain = last_gain if layer == len(sizes) else HIDDEN_GAIN
        kernel = torch.nn.init.orthogonal_(torch.empty(n_out, n_in), gain, generator)
        weights += [kernel.T.contiguous()[None], torch.zeros(1, n_out)]
    return weights
