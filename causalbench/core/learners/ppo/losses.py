"""The losses of proximal policy optimisation with the causal policy gradient, as one reads them.

Schulman et al. 2017. The paper, section "Causal Policy Gradient" after Hu, Stone and Martín-Martín 2023, has

    grad J(theta_i) = grad log pi_theta_i(ca_i | s) . m_i . A^pi_i(s, ca_i)

with m_i the causal matrix of stage i, actions as rows, and A the advantage "factored across the reward terms". Row k of
m_i times A is the advantage of action k; each action has a probability ratio of its own, clipped by itself.

Shapes: log_prob, ratio and advantage of each action (batch, n_actions); factored advantages, values and returns
(batch, n_critics); mask, the transposed m_i, (n_critics, n_actions); log_std (n_actions,).
"""

from __future__ import annotations

import torch
from torch import Tensor

from causalbench.core.networks.gaussian import LOG_SQRT_2PI


def causal_advantage(advantages: Tensor, mask: Tensor, floor: float) -> Tensor:
    """A_k = sum over c of m[k, c] * A_c, normalised (paper, section "Causal Policy Gradient": m_i . A)."""
    return normalise(advantages @ mask, floor)


def normalise(advantage: Tensor, floor: float) -> Tensor:
    """Zero mean and unit deviation for each action by itself.

    An action whose advantage hardly varies is divided by `floor` times the mean deviation of all, or its noise would be
    blown up to the size of a signal.
    """
    std = advantage.std(0)
    return (advantage - advantage.mean(0)) / (torch.maximum(std, floor * std.mean()) + 1e-8)


def policy_loss(ratio: Tensor, advantage: Tensor, clip_range: float) -> Tensor:
    """-sum over k of mean(min(r_k A_k, clip(r_k, 1 - clip_range, 1 + clip_range) A_k)).

    `ratio` is r_k = pi(a_k | s) / pi_old(a_k | s).
    """
    clipped = ratio.clamp(1 - clip_range, 1 + clip_range)
    return -torch.minimum(advantage * ratio, advantage * clipped).sum(1).mean()


def value_loss(values: Tensor, returns: Tensor) -> Tensor:
    """Squared error, averaged over the batch and summed over the value heads."""
    return (values - returns).square().sum() / len(returns)


def entropy(log_std: Tensor) -> Tensor:
    """Of the joint policy: sum over k of log std_k + (1 + log 2 pi) / 2."""
    return (log_std + 0.5 + LOG_SQRT_2PI).sum()


@torch.no_grad()
def joint_kl(log_ratio: Tensor) -> float:
    """Estimate of KL(old || new) of the joint policy: mean of (r - 1) - log r, as in stable-baselines3."""
    joint = log_ratio.sum(1)
    return float((joint.exp() - 1 - joint).mean())
