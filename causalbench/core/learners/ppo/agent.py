"""Proximal policy optimisation for one stage (paper, section "Training"), in the order of stable-baselines3's PPO.

`losses` says what it learns. Its gradients come from one of two engines that train the same weights: `fused`, which is
faster, or `autograd`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import torch
from torch import Tensor

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.ppo import autograd, fused, losses
from causalbench.core.learners.ppo.networks import Judged, PPONetworks, Samples
from causalbench.core.learners.ppo.rollout import Steps, gae
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.networks.gaussian import gaussian_log_prob
from causalbench.core.networks.state import State, below, load_optimizer, optimizer_state, prefixed
from causalbench.errors import DivergedError

ADAM_EPSILON = 1e-5  # as in SB3


class Engine(Protocol):
    """What writes the gradients of the losses where the optimiser looks for them."""

    def judge(self, networks: PPONetworks, batch: Samples) -> Judged:
        """The batch under the policy of now."""

    def policy_gradient(self, networks: PPONetworks, batch: Samples, judged: Judged) -> Tensor:
        """Of `losses.policy_loss` less `ent_coef` times the entropy, by mean and log std; returns the policy loss."""

    def value_gradient(self, networks: PPONetworks, batch: Samples) -> Tensor:
        """Of `vf_coef` times `losses.value_loss` by the values' weights; returns that loss."""


ENGINES: Mapping[str, Engine] = {"fused": fused, "autograd": autograd}


class PPOAgent:
    """The agent A_i of one stage: networks, their optimiser and the samples that its policy has not learned from."""

    def __init__(self, plan: StagePlan, n_obs: int, settings: PPOSettings, seed: int, sensor: str = "") -> None:
        self.settings, self.engine = settings, ENGINES[settings.engine]
        self.generator = torch.Generator().manual_seed(seed)
        self.networks = networks = PPONetworks(plan, n_obs, settings, sensor, self.generator)
        self.optimizer = torch.optim.Adam(networks.blocks, settings.learning_rate, eps=ADAM_EPSILON, fused=True)
        self.groups = torch.from_numpy(plan.reward_groups).float().T  # (n_terms, n_critics)
        self.own_actions = torch.from_numpy(plan.actions)
        n_actions, n_critics = plan.mask.shape
        self.samples = Samples(*(torch.zeros(0, n) for n in (n_obs, n_actions, n_actions, n_critics, n_critics)))
        self.updates = 0

    @property
    def policy_weights(self) -> list[Tensor]:
        """[W1, b1, ...] of the mean, W (n_in, n_out), then the log std: views, always the newest."""
        return [*(w[0] for w in self.networks.mean.weights), self.networks.log_std]

    def act(self, obs: Tensor) -> Tensor:
        """Actions (n, n_actions) of the agent's own dimensions, not clipped to their bounds; `obs` (n, n_obs)."""
        mean = self.networks.mean.forward(obs).outputs[0]
        return mean + self.networks.log_std.exp() * torch.randn(mean.shape, generator=self.generator)

    def collect(self, steps: Steps, stage: int) -> None:
        """Take this agent's steps out of an epoch, with factored advantages and lambda returns.

        An agent that is not trained keeps its policy and values, so samples of several epochs are all on-policy.
        """
        networks, own = self.networks, steps.stage == stage
        if not bool(own.any()):
            return
        stays = own & ~steps.done
        rewards = steps.rewards @ self.groups
        values, next_values = torch.zeros_like(rewards), torch.zeros_like(rewards)
        values[own] = networks.values.forward(steps.obs[own]).outputs[0]
        next_values[stays] = networks.values.forward(steps.next_obs[stays]).outputs[0]
        gamma, gae_lambda = self.settings.gamma, self.settings.gae_lambda
        advantages = torch.from_numpy(
            gae(rewards.numpy(), values.numpy(), next_values.numpy(), (stays & ~steps.over).numpy(), gamma, gae_lambda)
        )
        obs, actions = steps.obs[own], steps.actions[own][:, self.own_actions]
        log_prob = gaussian_log_prob(networks.mean.forward(obs).outputs[0], networks.log_std, actions)
        new = Samples(obs, actions, log_prob, advantages[own], (advantages + values)[own])
        self.samples = Samples(*(torch.cat(pair) for pair in zip(self.samples, new, strict=True)))

    def set_learning_rate(self, rate: float) -> None:
        """Train with `rate` from now on."""
        for group in self.optimizer.param_groups:
            group["lr"] = rate

    def train(self) -> None:
        """Algorithm 3, line "training pi_i with causal policy gradient method by using m_i".

        `n_epochs` passes over the samples, which are used up; fewer than one batch of them wait for more. Ends early
        when the joint policy has moved too far. Raises `DivergedError` when the loss is not finite.
        """
        n = len(self.samples.obs)
        if n < self.settings.batch_size:
            return
        packed = torch.cat(self.samples, 1)  # a batch is taken out in one go
        widths = [values.shape[1] for values in self.samples]
        policy_loss = value_loss = torch.zeros(())
        for rows in self._minibatches(n):
            batch = Samples(*torch.split(packed.index_select(0, rows), widths, 1))
            judged = self.engine.judge(self.networks, batch)
            if losses.joint_kl(judged.log_ratio) > 1.5 * self.settings.target_kl:
                break
            policy_loss, value_loss = self._update(batch, judged)
            self.updates += 1
        if not math.isfinite(float(policy_loss + value_loss)):
            raise DivergedError(
                f"loss is not finite after {self.updates} updates "
                f"(policy {float(policy_loss)}, value {float(value_loss)})"
            )
        self.samples = self.samples.rows(torch.zeros(0, dtype=torch.int64))

    def _update(self, batch: Samples, judged: Judged) -> tuple[Tensor, Tensor]:
        """One step of policy and values; their losses."""
        policy_loss = self.engine.policy_gradient(self.networks, batch, judged)
        value_loss = self.engine.value_gradient(self.networks, batch)
        torch.nn.utils.clip_grad_norm_(self.networks.blocks, self.settings.max_grad_norm)
        self.optimizer.step()
        return policy_loss, value_loss

    def state(self) -> State:
        """Everything that later steps depend on."""
        return {
            "updates": self.updates,
            "generator": self.generator.get_state(),
            "log_std": self.networks.log_std,
            **prefixed("mean", self.networks.mean.state()),
            **prefixed("values", self.networks.values.state()),
            **prefixed("optimizer", optimizer_state(self.optimizer)),
            **prefixed("samples", self.samples._asdict()),
        }

    def load_state(self, state: State) -> None:
        """Go on from what `state` gave."""
        self.updates = state["updates"]
        self.generator.set_state(state["generator"])
        self.networks.log_std.copy_(state["log_std"])
        self.networks.mean.load_state(below("mean", state))
        self.networks.values.load_state(below("values", state))
        load_optimizer(self.optimizer, below("optimizer", state))
        self.samples = Samples(**below("samples", state))

    def _minibatches(self, n: int) -> list[Tensor]:
        """Row indices of every batch of every pass; batches have `batch_size` rows or a few more, none is tiny."""
        passes = (torch.randperm(n, generator=self.generator) for _ in range(self.settings.n_epochs))
        return [rows for order in passes for rows in order.tensor_split(n // self.settings.batch_size)]
