"""Proximal policy optimisation per stage, with the causal policy gradient (paper, Causal Policy Gradient, Training).

Schulman et al. 2017 in the order of stable-baselines3's PPO. What the paper adds, after Hu, Stone and Martín-Martín
2023, is `policy_loss`: every action dimension has a probability ratio and an advantage of its own. At ratio 1, where
every update starts, an all-ones matrix makes it SB3's gradient.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from causalbench.core.encoder import Encoder
from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.gaussian_networks import (
    gaussian_actor_forward,
    gaussian_log_prob,
    init_gaussian_actor,
    init_values,
    tanh_mlp,
)
from causalbench.core.learners.learner import (
    State,
    below,
    load_optimizer,
    load_tensors,
    optimizer_state,
    prefixed,
    tensor_state,
)
from causalbench.core.learners.rollout import Steps, gae
from causalbench.core.learners.settings import PPOSettings
from causalbench.errors import DivergedError

ADAM_EPSILON = 1e-5  # as in SB3
HALF_LOG_2PI_E = 0.5 * math.log(2 * math.pi * math.e)  # entropy of a standard normal


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
        self.encoder = Encoder(sensor)  # one before the actor, one before the values
        self.generator = torch.Generator().manual_seed(seed)
        n_actions, n_critics = plan.mask.shape
        arch = settings.net_arch
        n_seen = n_obs - self.encoder.n_sensed + self.encoder.n_features
        self.actor = self.encoder.initial_weights(self.generator)
        self.actor += init_gaussian_actor(n_seen, arch, n_actions, settings.log_std_init, self.generator)
        self.values = self.encoder.initial_weights(self.generator)
        self.values += init_values(n_seen, arch, n_critics, self.generator)
        self.weights = [*self.actor, *self.values]
        for w in self.weights:
            w.requires_grad_()
        self.optimizer = torch.optim.Adam(self.weights, settings.learning_rate, eps=ADAM_EPSILON, fused=True)
        self.mask = torch.from_numpy(plan.mask).float().T.contiguous()  # (n_critics, n_actions)
        self.groups = torch.from_numpy(plan.reward_groups).float().T  # (n_terms, n_critics)
        self.own_actions = torch.from_numpy(plan.actions)
        self.samples = Samples(*(torch.zeros(0, n) for n in (n_obs, n_actions, n_actions, n_critics, n_critics)))
        self.updates = 0

    def act(self, obs: Tensor) -> Tensor:
        """Actions (n, n_actions) of the agent's own dimensions, not clipped to their bounds; `obs` (n, n_obs)."""
        with torch.no_grad():
            mean, log_std = gaussian_actor_forward(*self.encoder(self.actor, obs))
            return mean + log_std.exp() * torch.randn(mean.shape, generator=self.generator)

    @torch.no_grad()
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
        values[own] = tanh_mlp(*self.encoder(self.values, steps.obs[own]))
        next_values[stays] = tanh_mlp(*self.encoder(self.values, steps.next_obs[stays]))
        gamma, gae_lambda = self.settings.gamma, self.settings.gae_lambda
        advantages = torch.from_numpy(
            gae(rewards.numpy(), values.numpy(), next_values.numpy(), (stays & ~steps.over).numpy(), gamma, gae_lambda)
        )
        obs, actions = steps.obs[own], steps.actions[own][:, self.own_actions]
        log_prob = gaussian_log_prob(*gaussian_actor_forward(*self.encoder(self.actor, obs)), actions)
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
        for rows in self._minibatches(n):
            batch = self.samples.rows(rows)
            mean, log_std = gaussian_actor_forward(*self.encoder(self.actor, batch.obs))
            log_ratio = gaussian_log_prob(mean, log_std, batch.actions) - batch.log_prob
            if joint_kl(log_ratio) > 1.5 * settings.target_kl:
                break
            policy_loss = self.policy_loss(log_ratio, batch.advantages)
            value_loss = (tanh_mlp(*self.encoder(self.values, batch.obs)) - batch.returns).pow(2).mean(0).sum()
            entropy = (log_std + HALF_LOG_2PI_E).sum()
            loss = policy_loss + settings.vf_coef * value_loss - settings.ent_coef * entropy
            self._descend(loss)
            self.updates += 1
        if not bool(torch.isfinite(loss)):
            raise DivergedError(
                f"loss is not finite after {self.updates} updates "
                f"(policy {float(policy_loss.detach())}, value {float(value_loss.detach())})"
            )
        self.samples = self.samples.rows(torch.zeros(0, dtype=torch.int64))

    def policy_loss(self, log_ratio: Tensor, advantages: Tensor) -> Tensor:
        """Paper, eq. of the causal policy gradient, clipped: action k follows the rewards that it causes.

        `log_ratio` (batch, n_actions); `advantages` (batch, n_critics), factored. Row k of the matrix times the
        factored advantage is the advantage of action k; each dimension is clipped by itself, then they are summed.
        """
        per_action = self.normalise(advantages @ self.mask)
        ratio = log_ratio.exp()
        low, high = 1 - self.settings.clip_range, 1 + self.settings.clip_range
        return -torch.min(per_action * ratio, per_action * ratio.clamp(low, high)).sum(1).mean()

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
            **prefixed("weights", tensor_state(self.weights)),
            **prefixed("optimizer", optimizer_state(self.optimizer)),
            **prefixed("samples", self.samples._asdict()),
        }

    def load_state(self, state: State) -> None:
        """Go on from what `state` gave."""
        self.updates = state["updates"]
        self.generator.set_state(state["generator"])
        load_tensors(self.weights, below("weights", state))
        load_optimizer(self.optimizer, below("optimizer", state))
        self.samples = Samples(**below("samples", state))

    def _minibatches(self, n: int) -> list[Tensor]:
        """Row indices of every batch of every pass; batches have `batch_size` rows or a few more, none is tiny."""
        passes = (torch.randperm(n, generator=self.generator) for _ in range(self.settings.n_epochs))
        return [rows for order in passes for rows in order.tensor_split(n // self.settings.batch_size)]

    def _descend(self, loss: Tensor) -> None:
        for w, gradient in zip(self.weights, torch.autograd.grad(loss, self.weights), strict=True):
            w.grad = gradient
        torch.nn.utils.clip_grad_norm_(self.weights, self.settings.max_grad_norm)
        self.optimizer.step()


def joint_kl(log_ratio: Tensor) -> float:
    """Estimate of KL(old || new) of the joint policy, mean of (r - 1) - log r as in SB3; `log_ratio` (batch, n)."""
    joint = log_ratio.detach().sum(1)
    return float((joint.exp() - 1 - joint).mean())
