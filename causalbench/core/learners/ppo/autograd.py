"""The engine that reads like the paper: autograd differentiates `losses`."""

from __future__ import annotations

from torch import Tensor

from causalbench.core.learners.ppo import losses
from causalbench.core.learners.ppo.networks import Judged, PPONetworks, Samples
from causalbench.core.networks.stacked import differentiate


def judge(networks: PPONetworks, batch: Samples) -> Judged:
    """The batch under the policy of now, recorded."""
    return networks.judge(networks.mean.recorded(), networks.log_std.detach().requires_grad_(), batch)


def policy_gradient(networks: PPONetworks, batch: Samples, judged: Judged) -> Tensor:
    """Write the policy's gradient of `losses.policy_loss` less `ent_coef` times the entropy; return the policy loss."""
    settings = networks.settings
    advantage = losses.causal_advantage(batch.advantages, networks.mask, settings.advantage_floor)
    policy_loss = losses.policy_loss(judged.log_ratio.exp(), advantage, settings.clip_range)
    loss = policy_loss - settings.ent_coef * losses.entropy(judged.log_std)
    assert networks.log_std.grad is not None
    differentiate(loss, [*judged.mean.weights, judged.log_std], [*judged.mean.gradients, networks.log_std.grad])
    return policy_loss.detach()


def value_gradient(networks: PPONetworks, batch: Samples) -> Tensor:
    """Write the values' gradient of `vf_coef` times `losses.value_loss`; return that loss."""
    values = networks.values.recorded()
    value_loss = losses.value_loss(values.forward(batch.obs).outputs[0], batch.returns)
    differentiate(networks.settings.vf_coef * value_loss, values.weights, values.gradients)
    return value_loss.detach()
