"""KL divergence between the reward distributions with and without an action (paper, Causal Discovery)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor


class Divergence(NamedTuple):
    """Means over D_inference, shape of the inputs without their last dimension, in nats."""

    forward: Tensor  # KL(P1 || P2)
    reverse: Tensor  # KL(P2 || P1)
    symmetric: Tensor  # the mean of both


def gaussian_kl(mean_p: Tensor, sigma_p: Tensor, mean_q: Tensor, sigma_q: Tensor) -> Tensor:
    """KL(p || q) of univariate normals, elementwise, in nats."""
    return torch.log(sigma_q / sigma_p) + (sigma_p**2 + (mean_p - mean_q) ** 2) / (2 * sigma_q**2) - 0.5


def divergence(
    mean_1: Tensor, log_sigma_1: Tensor, mean_2: Tensor, log_sigma_2: Tensor, sigma_floor: float
) -> Divergence:
    """KL between P1 = p(r | s, do(a_k = 0)) and P2 = p(r | s, random a_k), each (..., n_inference).

    Sigmas, in deviations of the term, are floored: in a nearly deterministic simulator KL otherwise explodes and
    hides true but weaker causes. The mean over states is taken, since a median misses causes that act in few.
    """
    sigma_1, sigma_2 = (s.exp().clamp_min(sigma_floor).double() for s in (log_sigma_1, log_sigma_2))
    mean_1, mean_2 = mean_1.double(), mean_2.double()
    forward = gaussian_kl(mean_1, sigma_1, mean_2, sigma_2).mean(-1)
    reverse = gaussian_kl(mean_2, sigma_2, mean_1, sigma_1).mean(-1)
    return Divergence(forward, reverse, (forward + reverse) / 2)
