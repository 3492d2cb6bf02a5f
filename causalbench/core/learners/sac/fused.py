"""The fast engine: the gradients of `losses`, written out.

It takes the gradients that an update needs and no others: none by the critics' weights in the actor's step, and none
through the twin that is not the lesser one. A test holds it equal to autograd on every plan.
"""

from __future__ import annotations

import torch
from torch import Tensor

from causalbench.core.learners.sac import losses
from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.networks import Drawn, SACNetworks
from causalbench.core.networks.squashed_gaussian import LOG_STD_MAX, LOG_STD_MIN, TANH_EPSILON


def draw(networks: SACNetworks, obs: Tensor, noise: Tensor) -> Drawn:
    """Actions of the policy at `obs` (batch, n_obs)."""
    return networks.draw(networks.actor, obs, noise)


def critic_gradient(networks: SACNetworks, batch: Batch, following: Drawn, alpha: Tensor) -> Tensor:
    """Write the critics' gradient of `losses.critic_loss` and return that loss."""
    target = networks.target(batch, following, alpha)
    passed = networks.critics.forward(batch.obs, batch.actions)
    error = networks.twins(passed.outputs) - target
    networks.critics.backward(passed, (error / len(batch.obs)).view(passed.outputs.mT.shape).mT)
    return 0.5 * error.square().sum() / len(batch.obs)


def actor_gradient(
    networks: SACNetworks, obs: Tensor, drawn: Drawn, alpha: Tensor, following: SACNetworks | None = None
) -> Tensor:
    """Write the actor's gradient of `losses.actor_loss` and return that loss; `following` cooperates (cSAC)."""
    value, slope = causal_value(networks, obs, drawn.action)
    if following is not None:
        other, other_slope = causal_value(following, obs, drawn.action)
        scales, weight = networks.scales(value, other), networks.settings.cooperation_weight
        value = losses.cooperative_value(value, other, scales, weight)
        slope = losses.cooperative_value(slope, other_slope, scales, weight)
    # action = tanh(x), x = mean + std * noise, log_prob = ... - log_std - log(1 - action^2 + epsilon)
    squash = 1 - drawn.action.square()  # d action / dx
    by_x = (alpha * 2 * drawn.action / (squash + TANH_EPSILON) - slope) * squash / len(obs)
    log_std = drawn.passed.outputs[0].chunk(2, -1)[1]
    inside = (log_std >= LOG_STD_MIN) & (log_std <= LOG_STD_MAX)  # the clamp has no slope outside
    by_log_std = (by_x * log_std.exp() * drawn.noise - alpha / len(obs)) * inside
    networks.actor.backward(drawn.passed, torch.cat([by_x, by_log_std], 1)[None])
    return losses.actor_loss(value, drawn.log_prob, alpha)


def causal_value(networks: SACNetworks, obs: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
    """(batch,) `losses.causal_value`, and its gradient (batch, n_actions) by the actions."""
    passed = networks.critics.forward(obs, action)
    q, twin = losses.lesser_twin(networks.twins(passed.outputs), networks.joint_twin)
    n_nets, n_actions = networks.n_nets, action.shape[1]
    slope = torch.zeros(action.shape, dtype=action.dtype)
    for net in range(2 * n_nets):
        critics = slice(net % n_nets, net % n_nets + 1) if n_nets > 1 else slice(None)
        heads, rows = (twin[critics] == net // n_nets).nonzero().unbind(1)
        own = networks.critics.action_gradient(passed, net, rows, heads, n_actions)
        slope.index_add_(0, rows, own * networks.mask[critics].index_select(0, heads))
    return q.sum(0), slope


def alpha_gradient(networks: SACNetworks, log_prob: Tensor) -> None:
    """Write the temperature's gradient of `losses.alpha_loss`."""
    assert networks.log_alpha.grad is not None
    networks.log_alpha.grad[0] = -(log_prob.mean() + networks.target_entropy)
