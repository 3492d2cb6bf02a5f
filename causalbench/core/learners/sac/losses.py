"""The losses of soft actor-critic with the causal policy gradient, as one reads them. Autograd differentiates them.

Haarnoja et al. 2018 with twin critics and a learned temperature. The paper, section "Causal Policy Gradient", has

    grad J(theta_i) = grad log pi_theta_i(ca_i | s) . m_i . A^pi_i(s, ca_i)

with m_i the causal matrix of stage i, actions as rows, and A the advantage "factored across the reward terms". SAC
climbs values, not advantages: action k climbs the critics of the rewards that it causes, no others (`causal_value`).

Shapes: action (batch, n_actions); log_prob, done (batch,); rewards (batch, n_critics); q (2, n_critics, batch), of both
twins; mask, the transposed m_i, (n_critics, n_actions).
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

Critics = Callable[[Tensor, Tensor], Tensor]
"""Observations and actions to q; actions (n_critics, batch, n_actions) are judged by one critic each."""


def lesser_twin(q: Tensor, joint_twin: bool) -> tuple[Tensor, Tensor]:
    """Values (n_critics, batch) of the more cautious twin, and which twin that is.

    It is chosen for each critic by itself, or with `joint_twin` by the sum over critics, where only that is a value.
    """
    if not joint_twin:
        return q.min(0)
    which = q.sum(1).argmin(0).expand(q.shape[1:])
    return q.gather(0, which[None])[0], which


def bellman_target(
    rewards: Tensor, done: Tensor, next_q: Tensor, next_log_prob: Tensor, alpha: Tensor, gamma: float, entropy: Tensor
) -> Tensor:
    """(n_critics, batch): r_c + gamma * (1 - done) * (Q_c(s', a') - alpha * log pi(a' | s')), a' of the policy.

    `next_q` (n_critics, batch) is the lesser target twin's; `entropy` (n_critics, 1) is 1 where the bonus enters.
    """
    soft_value = next_q - entropy * (alpha * next_log_prob)
    return rewards.T + gamma * (1 - done) * soft_value


def critic_loss(q: Tensor, target: Tensor) -> Tensor:
    """Half the squared Bellman error, averaged over the batch and summed over critics and twins."""
    return 0.5 * (q - target).square().sum() / q.shape[-1]


def causal_value(critics: Critics, obs: Tensor, action: Tensor, mask: Tensor, joint_twin: bool) -> Tensor:
    """(batch,): sum over c of min over twins of Q_c(s, m_c * a + (1 - m_c) * stop_gradient(a)).

    Critic c sees the whole action but teaches only the dimensions that cause its reward (paper, section "Training":
    "only the reward values of the action outcomes are passed to the corresponding actions").
    """
    m = mask[:, None, :]
    causes = m * action + (1 - m) * action.detach()  # (n_critics, batch, n_actions)
    return lesser_twin(critics(obs, causes), joint_twin)[0].sum(0)


def cooperative_value(own: Tensor, following: Tensor, scales: tuple[float, float], weight: float) -> Tensor:
    """cSAC's convex combination z_i * ((1 - w) * Q_i / z_i + w * Q_{i+1} / z_{i+1}) of two stages' values.

    After Erskine and Lehnert 2022, our reading: `scales` are z_i and z_{i+1}, running means of both values' sizes on
    this stage's states. The factor z_i keeps the temperature's meaning.
    """
    return (1 - weight) * own + weight * scales[0] / scales[1] * following


def actor_loss(value: Tensor, log_prob: Tensor, alpha: Tensor) -> Tensor:
    """Mean of alpha * log pi(a | s) - value(s, a)."""
    return (alpha * log_prob - value).mean()


def alpha_loss(log_alpha: Tensor, log_prob: Tensor, target_entropy: float) -> Tensor:
    """Mean of -log_alpha * (log pi(a | s) + target entropy), which is minus the number of the agent's own actions."""
    return -(log_alpha * (log_prob.detach() + target_entropy)).mean()
