"""What the agent of one stage learns: actor, twin critics with their targets, temperature."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.sac import losses
from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.networks.encoded import network
from causalbench.core.networks.encoder import Encoder
from causalbench.core.networks.init import uniform_mlp
from causalbench.core.networks.squashed_gaussian import mean_and_log_std, squashed_sample
from causalbench.core.networks.stacked import Pass, StackedMLP

SCALE_DECAY = 0.99  # of the running mean |Q| that cSAC normalises by
LEAST_SCALE = 1e-2


class Drawn(NamedTuple):
    """Actions that a policy drew, with what their gradient needs."""

    actor: StackedMLP
    passed: Pass  # of the actor
    noise: Tensor  # (batch, n_actions)
    action: Tensor  # (batch, n_actions)
    log_prob: Tensor  # (batch,)

    def rows(self, rows: slice) -> Drawn:
        """Those of some batch rows."""
        return Drawn(self.actor, self.passed.rows(rows), self.noise[rows], self.action[rows], self.log_prob[rows])


class SACNetworks:
    """Weights of one stage's agent, and its plan as tensors.

    The twins of a critic are networks i and i + n_nets, of n_nets = n_critics with one output each, or of one network
    with an output per critic (`critics: heads`). One encoder stands before the actor and one before all critics.
    """

    def __init__(self, plan: StagePlan, n_obs: int, settings: SACSettings, sensor: str, generator: torch.Generator):
        self.settings, self.joint_twin = settings, plan.joint_twin
        n_actions, n_critics = plan.mask.shape
        self.n_nets, n_heads = (1, n_critics) if settings.critics == "heads" else (n_critics, 1)
        self.encoder = encoder = Encoder(sensor)
        arch, n_seen = settings.net_arch, encoder.n_seen(n_obs)
        weights = encoder.initial_weights(generator, 1) + uniform_mlp(1, (n_seen, *arch, 2 * n_actions), generator)
        self.actor = network(encoder, weights, "relu")
        weights = encoder.initial_weights(generator, 1)
        weights += uniform_mlp(2 * self.n_nets, (n_seen + n_actions, *arch, n_heads), generator)
        self.critics, self.targets = (network(encoder, weights, "relu") for _ in range(2))
        self.log_alpha = torch.tensor([math.log(settings.ent_coef_init)])
        self.log_alpha.grad = torch.zeros(1)
        self.target_entropy = -float(n_actions)
        self.mask = torch.from_numpy(plan.mask).to(self.actor.flat.dtype).T.contiguous()  # (n_critics, n_actions)
        self.entropy = torch.from_numpy(plan.entropy).float()[:, None]  # (n_critics, 1)
        self.own_scale = self.next_scale = 1.0  # running mean |Q| of both critics on this stage's states (cSAC)

    def draw(self, actor: StackedMLP, obs: Tensor, noise: Tensor) -> Drawn:
        """Actions tanh(mean + std * noise) of `actor` at `obs` (batch, n_obs)."""
        passed = actor.forward(obs)
        return Drawn(actor, passed, noise, *squashed_sample(*mean_and_log_std(passed.outputs[0]), noise))

    def twins(self, outputs: Tensor) -> Tensor:
        """(2, n_critics, batch) q of both twins from the critics' outputs (2 * n_nets, batch, n_heads)."""
        return outputs.mT.reshape(2, len(self.mask), -1)

    @torch.no_grad()
    def target(self, batch: Batch, following: Drawn, alpha: Tensor) -> Tensor:
        """(n_critics, batch) that the critics are to learn; `following` are the policy's actions at the next states."""
        q = self.twins(self.targets.forward(batch.next_obs, following.action).outputs)
        next_q, gamma = losses.lesser_twin(q, self.joint_twin)[0], self.settings.gamma
        return losses.bellman_target(batch.rewards, batch.done, next_q, following.log_prob, alpha, gamma, self.entropy)

    def q(self, obs: Tensor, action: Tensor) -> Tensor:
        """(2, n_critics, batch) q of both twins; `action` (n_critics, batch, n_actions) has one for each critic."""
        n_critics, n = len(self.mask), len(obs)
        inputs = torch.cat([self.critics.features(obs).expand(n_critics, -1, -1), action], -1)
        if self.n_nets == n_critics:
            return self.twins(self.critics.layers(inputs.repeat(2, 1, 1))[-1])
        outputs = self.critics.layers(inputs.flatten(0, 1))[-1]  # of every head for every critic's action
        return outputs.reshape(2, n_critics, n, n_critics).diagonal(dim1=1, dim2=3).mT

    def scales(self, own: Tensor, following: Tensor) -> tuple[float, float]:
        """z_i and z_{i+1}, the running sizes of both stages' values, after those of a batch (batch,) joined them."""
        self.own_scale = _running(self.own_scale, own)
        self.next_scale = _running(self.next_scale, following)
        return max(self.own_scale, LEAST_SCALE), max(self.next_scale, LEAST_SCALE)


def _running(scale: float, value: Tensor) -> float:
    return SCALE_DECAY * scale + (1 - SCALE_DECAY) * float(value.abs().mean())
