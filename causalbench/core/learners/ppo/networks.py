"""What the agent of one stage learns: the mean of its Gaussian policy, the log std, and a value head per critic."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.networks.encoded import network
from causalbench.core.networks.encoder import Encoder
from causalbench.core.networks.gaussian import gaussian_log_prob
from causalbench.core.networks.init import orthogonal_mlp
from causalbench.core.networks.stacked import Pass, StackedMLP

ACTOR_GAIN, VALUE_GAIN = 0.01, 1.0  # of the last layer's orthogonal kernel, as in SB3


class Samples(NamedTuple):
    """What an agent learns from, float32."""

    obs: Tensor  # (n, n_obs)
    actions: Tensor  # (n, n_actions) of the agent's own actions
    log_prob: Tensor  # (n, n_actions) under the policy that drew them
    advantages: Tensor  # (n, n_critics)
    returns: Tensor  # (n, n_critics)

    def rows(self, rows: Tensor) -> Samples:
        """Those of the given indices."""
        return Samples(*(values[rows] for values in self))


class Judged(NamedTuple):
    """What the policy of now thinks of the actions of a batch, with what its gradient needs."""

    mean: StackedMLP
    log_std: Tensor  # (n_actions,)
    passed: Pass  # of the mean
    log_ratio: Tensor  # (batch, n_actions) to the policy that drew them


class PPONetworks:
    """Weights of one stage's agent, and its mask as a tensor.

    One encoder stands before the mean and one before the values.
    """

    def __init__(self, plan: StagePlan, n_obs: int, settings: PPOSettings, sensor: str, generator: torch.Generator):
        self.settings = settings
        n_actions, n_critics = plan.mask.shape
        encoder = Encoder(sensor)
        sizes = (encoder.n_seen(n_obs), *settings.net_arch)
        weights = encoder.initial_weights(generator, 1)
        weights += orthogonal_mlp((*sizes, n_actions), ACTOR_GAIN, generator)
        self.mean = network(encoder, weights, "tanh")
        self.log_std = torch.full((n_actions,), settings.log_std_init)
        self.log_std.grad = torch.zeros(n_actions)
        weights = encoder.initial_weights(generator, 1)
        weights += orthogonal_mlp((*sizes, n_critics), VALUE_GAIN, generator)
        self.values = network(encoder, weights, "tanh")
        self.mask = torch.from_numpy(plan.mask).to(self.log_std.dtype).T.contiguous()  # (n_critics, n_actions)

    @property
    def blocks(self) -> list[Tensor]:
        """What the optimiser goes over."""
        return [self.mean.flat, self.log_std, self.values.flat]

    def judge(self, mean: StackedMLP, log_std: Tensor, batch: Samples) -> Judged:
        """The batch under the policy with `mean` and `log_std`."""
        passed = mean.forward(batch.obs)
        log_prob = gaussian_log_prob(passed.outputs[0], log_std, batch.actions)
        return Judged(mean, log_std, passed, log_prob - batch.log_prob)
