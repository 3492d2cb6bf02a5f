"""The engine that reads like the paper: autograd differentiates `losses`."""

from __future__ import annotations

from torch import Tensor

from causalbench.core.learners.sac import losses
from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.networks import Drawn, SACNetworks
from causalbench.core.networks.stacked import differentiate


def draw(networks: SACNetworks, obs: Tensor, noise: Tensor) -> Drawn:
    """Actions of the policy at `obs` (batch, n_obs), recorded."""
    return networks.draw(networks.actor.recorded(), obs, noise)


def critic_gradient(networks: SACNetworks, batch: Batch, following: Drawn, alpha: Tensor) -> Tensor:
    """Write the critics' gradient of `losses.critic_loss` and return that loss."""
    target = networks.target(batch, following, alpha)
    critics = networks.critics.recorded()
    loss = losses.critic_loss(networks.twins(critics.forward(batch.obs, batch.actions).outputs), target)
    differentiate(loss, critics.weights, critics.gradients)
    return loss.detach()


def actor_gradient(
    networks: SACNetworks, obs: Tensor, drawn: Drawn, alpha: Tensor, following: SACNetworks | None = None
) -> Tensor:
    """Write the actor's gradient of `losses.actor_loss` and return that loss; `following` cooperates (cSAC)."""
    value = losses.causal_value(networks.q, obs, drawn.action, networks.mask, networks.joint_twin)
    if following is not None:
        other = losses.causal_value(following.q, obs, drawn.action, following.mask, following.joint_twin)
        scales = networks.scales(value.detach(), other.detach())
        value = losses.cooperative_value(value, other, scales, networks.settings.cooperation_weight)
    loss = losses.actor_loss(value, drawn.log_prob, alpha)
    differentiate(loss, drawn.actor.weights, drawn.actor.gradients)
    return loss.detach()


def alpha_gradient(networks: SACNetworks, log_prob: Tensor) -> None:
    """Write the temperature's gradient of `losses.alpha_loss`."""
    log_alpha = networks.log_alpha.detach().requires_grad_()
    assert networks.log_alpha.grad is not None
    loss = losses.alpha_loss(log_alpha, log_prob, networks.target_entropy)
    differentiate(loss, [log_alpha], [networks.log_alpha.grad])
