"""The fast engine: the gradients of `losses`, written out. A test holds it equal to autograd on every plan."""

from __future__ import annotations

import torch
from torch import Tensor

from causalbench.core.learners.ppo import losses
from causalbench.core.learners.ppo.networks import Judged, PPONetworks, Samples


def judge(networks: PPONetworks, batch: Samples) -> Judged:
    """The batch under the policy of now."""
    return networks.judge(networks.mean, networks.log_std, batch)


def policy_gradient(networks: PPONetworks, batch: Samples, judged: Judged) -> Tensor:
    """Write the policy's gradient of `losses.policy_loss` less `ent_coef` times the entropy; return the policy loss."""
    settings, log_std = networks.settings, judged.log_std
    advantage = losses.causal_advantage(batch.advantages, networks.mask, settings.advantage_floor)
    ratio = judged.log_ratio.exp()
    climbed = advantage * ratio
    clipped = advantage * ratio.clamp(1 - settings.clip_range, 1 + settings.clip_range)
    # The lesser of both has a slope unless it is the clipped one; inside the range they are the same.
    by_log_prob = torch.where(climbed <= clipped, climbed, 0.0) / -len(ratio)
    off = (batch.actions - judged.passed.outputs[0]) * torch.exp(-log_std)  # in units of the deviation
    networks.mean.backward(judged.passed, (by_log_prob * off * torch.exp(-log_std))[None])
    assert log_std.grad is not None
    torch.sub((by_log_prob * (off.square() - 1)).sum(0), settings.ent_coef, out=log_std.grad)
    return -torch.minimum(climbed, clipped).sum(1).mean()


def value_gradient(networks: PPONetworks, batch: Samples) -> Tensor:
    """Write the values' gradient of `vf_coef` times `losses.value_loss`; return that loss."""
    passed = networks.values.forward(batch.obs)
    error = passed.outputs - batch.returns
    networks.values.backward(passed, error * (2 * networks.settings.vf_coef / len(batch.obs)))
    return error.square().sum() / len(batch.obs)
