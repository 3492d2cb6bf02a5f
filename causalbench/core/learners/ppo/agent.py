"""Proximal policy optimisation per stage, with the causal policy gradient (paper, Causal Policy Gradient, Training).

Schulman et al. 2017 in the order of stable-baselines3's PPO. What the paper adds, after Hu, Stone and Martín-Martín
2023, is `policy_gradient`: every action dimension has a probability ratio and an advantage of its own. At ratio 1,
where every update starts, an all-ones matrix makes it SB3's gradient. Gradients are written out (`StackedMLP`); the
tests hold them against SB3's and against finite differences.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.ppo.rollout import Steps, gae
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.networks.encoded import network
from causalbench.core.networks.encoder import Encoder
from causalbench.core.networks.gaussian import gaussian_log_prob, init_gaussian_actor, init_values
from causalbench.core.networks.state import State, below, load_optimizer, optimizer_state, prefixed
from causalbench.errors import DivergedError

ADAM_EPSILON = 1e-5  # as in SB3


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


class PPOAgent:
    """The agent A_i of one stage: policy, value heads and the samples that its policy has not learned from."""

    def __init__(self, plan: StagePlan, n_obs: int, settings: PPOSettings, seed: int, sensor: str = "") -> None:
        self.plan, self.settings = plan, settings
        self.generator = torch.Generator().manual_seed(seed)
        n_actions, n_critics = plan.mask.shape
        arch = settings.net_arch
        encoder = Encoder(sensor)  # one before the mean, one before the values
        n_seen, kernels = encoder.n_seen(n_obs), encoder.initial_weights(self.generator)
        *mean, self.log_std = init_gaussian_actor(n_seen, arch, n_actions, settings.log_std_init, self.generator)
        self.log_std.grad = torch.zeros(n_actions)
        self.mean = network(encoder, [w[None] for w in (*kernels, *mean)], n_obs, "tanh")
        kernels = encoder.initial_weights(self.generator)
        values = init_values(n_seen, arch, n_critics, self.generator)
        self.values = network(encoder, [w[None] for w in (*kernels, *values)], n_obs, "tanh")
        self.weights = [self.mean.flat, self.log_std, self.values.flat]
        self.optimizer = torch.optim.Adam(self.weights, settings.learning_rate, eps=ADAM_EPSILON, fused=True)
        self.mask = torch.from_numpy(plan.mask).to(self.log_std.dtype).T.contiguous()  # (n_critics, n_actions)
        self.groups = torch.from_numpy(plan.reward_groups).float().T  # (n_terms, n_critics)
        self.own_actions = torch.from_numpy(plan.actions)
        self.samples = Samples(*(torch.zeros(0, n) for n in (n_obs, n_actions, n_actions, n_critics, n_critics)))
        self.updates = 0

    @property
    def policy_weights(self) -> list[Tensor]:
        """[W1, b1, ...] of the mean, W (n_in, n_out), then the log std: views, always the newest."""
        return [*(w[0] for w in self.mean.weights), self.log_std]

    def act(self, obs: Tensor) -> Tensor:
        """Actions (n, n_actions) of the agent's own dimensions, not clipped to their bounds; `obs` (n, n_obs)."""
        mean = self.mean.forward(obs)[-1][0]
        return mean + self.log_std.exp() * torch.randn(mean.shape, generator=self.generator)

    def collect(self, steps: Steps, stage: int) -> None:
        """Take this agent's steps out of an epoch, with factored advantages and lambda returns.

        An agent that is not trained keeps its policy and values, so samples of several epochs are all on-policy.
        """
        own = steps.stage == stage
        if not bool(own.any()):
            return
        stays = own & ~steps.done
        rewards = steps.rewards @ self.groups
        values, next_values = torch.zeros_like(rewards), torch.zeros_like(rewards)
        values[own] = self.values.forward(steps.obs[own])[-1][0]
        next_values[stays] = self.values.forward(steps.next_obs[stays])[-1][0]
        gamma, gae_lambda = self.settings.gamma, self.settings.gae_lambda
        advantages = torch.from_numpy(
            gae(rewards.numpy(), values.numpy(), next_values.numpy(), (stays & ~steps.over).numpy(), gamma, gae_lambda)
        )
        obs, actions = steps.obs[own], steps.actions[own][:, self.own_actions]
        log_prob = gaussian_log_prob(self.mean.forward(obs)[-1][0], self.log_std, actions)
        new = Samples(obs, actions, log_prob, advantages[own], (advantages + values)[own])
        self.samples = Samples(*(torch.cat(pair) for pair in zip(self.samples, new, strict=True)))

    def train(self) -> None:
        """Algorithm 3, line "training pi_i with causal policy gradient method by using m_i".

        `n_epochs` passes over the samples, which are used up; fewer than one batch of them wait for more. Ends early
        when the joint policy has moved too far. Raises `DivergedError` when the loss is not finite.
        """
        settings, n = self.settings, len(self.samples.obs)
        if n < settings.batch_size:
            return
        packed = torch.cat(self.samples, 1)  # a batch is taken out in one go
        widths = [values.shape[1] for values in self.samples]
        for rows in self._minibatches(n):
            batch = Samples(*torch.split(packed.index_select(0, rows), widths, 1))
            layers = self.mean.forward(batch.obs)
            log_ratio = gaussian_log_prob(layers[-1][0], self.log_std, batch.actions) - batch.log_prob
            if joint_kl(log_ratio) > 1.5 * settings.target_kl:
                break
            policy_loss = self.policy_gradient(batch, layers, log_ratio)
            value_loss = self.value_gradient(batch)
            torch.nn.utils.clip_grad_norm_(self.weights, settings.max_grad_norm)
            self.optimizer.step()
            self.updates += 1
        if not math.isfinite(float(policy_loss + value_loss)):
            raise DivergedError(
                f"loss is not finite after {self.updates} updates "
                f"(policy {float(policy_loss)}, value {float(value_loss)})"
            )
        self.samples = self.samples.rows(torch.zeros(0, dtype=torch.int64))

    def policy_gradient(self, batch: Samples, layers: list[Tensor], log_ratio: Tensor) -> Tensor:
        """Of the policy loss less `ent_coef` times the entropy; gives the policy loss.

        Paper, eq. of the causal policy gradient, clipped: action k follows the rewards that it causes. Row k of the
        matrix times the factored advantage is the advantage of action k; each dimension is clipped by itself, then they
        are summed. `layers` are those of the mean, `log_ratio` (batch, n_actions) to the policy that drew.
        """
        advantages, ratio = self.normalise(batch.advantages @ self.mask), log_ratio.exp()
        low, high = 1 - self.settings.clip_range, 1 + self.settings.clip_range
        climbed, clipped = advantages * ratio, advantages * ratio.clamp(low, high)
        # The lesser of both has a slope unless it is the clipped one; inside the range they are the same.
        by_log_prob = torch.where(climbed <= clipped, climbed, 0.0) / -len(ratio)
        off = (batch.actions - layers[-1][0]) * torch.exp(-self.log_std)  # in units of the deviation
        self.mean.backward(layers, (by_log_prob * off * torch.exp(-self.log_std))[None])
        assert self.log_std.grad is not None
        torch.sub((by_log_prob * (off.square() - 1)).sum(0), self.settings.ent_coef, out=self.log_std.grad)
        return -torch.minimum(climbed, clipped).sum(1).mean()

    def value_gradient(self, batch: Samples) -> Tensor:
        """Of `vf_coef` times the squared error of the value heads; gives that error."""
        layers = self.values.forward(batch.obs)
        error = layers[-1] - batch.returns
        self.values.backward(layers, error * (2 * self.settings.vf_coef / len(batch.obs)))
        return error.square().sum() / len(batch.obs)

    def normalise(self, advantages: Tensor) -> Tensor:
        """Zero mean and unit deviation per dimension, (batch, n_actions).

        A dimension whose advantage hardly varies is divided by a share of the mean deviation of all, or its noise
        would be blown up to the size of a signal.
        """
        std = advantages.std(0)
        least = self.settings.advantage_floor * std.mean()
        return (advantages - advantages.mean(0)) / (torch.maximum(std, least) + 1e-8)

    def state(self) -> State:
        """Everything that later steps depend on."""
        return {
            "updates": self.updates,
            "generator": self.generator.get_state(),
            "log_std": self.log_std,
            **prefixed("mean", self.mean.state()),
            **prefixed("values", self.values.state()),
            **prefixed("optimizer", optimizer_state(self.optimizer)),
            **prefixed("samples", self.samples._asdict()),
        }

    def load_state(self, state: State) -> None:
        """Go on from what `state` gave."""
        self.updates = state["updates"]
        self.generator.set_state(state["generator"])
        self.log_std.copy_(state["log_std"])
        self.mean.load_state(below("mean", state))
        self.values.load_state(below("values", state))
        load_optimizer(self.optimizer, below("optimizer", state))
        self.samples = Samples(**below("samples", state))

    def _minibatches(self, n: int) -> list[Tensor]:
        """Row indices of every batch of every pass; batches have `batch_size` rows or a few more, none is tiny."""
        passes = (torch.randperm(n, generator=self.generator) for _ in range(self.settings.n_epochs))
        return [rows for order in passes for rows in order.tensor_split(n // self.settings.batch_size)]


def joint_kl(log_ratio: Tensor) -> float:
    """Estimate of KL(old || new) of the joint policy, mean of (r - 1) - log r as in SB3; `log_ratio` (batch, n)."""
    joint = log_ratio.sum(1)
    return float((joint.exp() - 1 - joint).mean())
