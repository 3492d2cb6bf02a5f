"""Soft actor-critic for one stage (paper, section "Training"), in the order of stable-baselines3's SAC.

`losses` says what it learns. Its gradients come from one of two engines that train the same weights: `fused`, which is
faster, or `autograd`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import torch
from torch import Tensor

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.sac import autograd, fused
from causalbench.core.learners.sac.buffer import Batch, StageBuffer
from causalbench.core.learners.sac.frame_buffer import FrameBuffer
from causalbench.core.learners.sac.networks import Drawn, SACNetworks
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.networks.squashed_gaussian import squashed_actor, squashed_sample
from causalbench.core.networks.stacked import StackedMLP
from causalbench.core.networks.state import State, below, load_optimizer, optimizer_state, prefixed
from causalbench.errors import DivergedError

EXPLODED = 1e10  # loss at which training has diverged: values are wrong by about 1e5 stage bonuses


class Engine(Protocol):
    """What writes the gradients of the losses where the optimisers look for them."""

    def draw(self, networks: SACNetworks, obs: Tensor, noise: Tensor) -> Drawn:
        """Actions of the policy at `obs` (batch, n_obs); `noise` (batch, n_actions)."""

    def critic_gradient(self, networks: SACNetworks, batch: Batch, following: Drawn, alpha: Tensor) -> Tensor:
        """Of `losses.critic_loss` by the critics' weights; returns that loss."""

    def actor_gradient(
        self, networks: SACNetworks, obs: Tensor, drawn: Drawn, alpha: Tensor, following: SACNetworks | None
    ) -> Tensor:
        """Of `losses.actor_loss` by the actor's weights; returns that loss."""

    def alpha_gradient(self, networks: SACNetworks, log_prob: Tensor) -> None:
        """Of `losses.alpha_loss` by the logarithm of the temperature."""


ENGINES: Mapping[str, Engine] = {"fused": fused, "autograd": autograd}


class SACAgent:
    """The agent A_i of one stage: networks, their optimisers and a buffer."""

    def __init__(self, plan: StagePlan, n_obs: int, settings: SACSettings, seed: int, sensor: str = "") -> None:
        self.settings, self.engine = settings, ENGINES[settings.engine]
        self.generator = torch.Generator().manual_seed(seed)
        self.networks = networks = SACNetworks(plan, n_obs, settings, sensor, self.generator)
        lr = settings.learning_rate
        self.actor_optimizer = torch.optim.Adam([networks.actor.flat, networks.log_alpha], lr, fused=True)
        self.critic_optimizer = torch.optim.Adam([networks.critics.flat], lr, fused=True)
        n_actions, n_critics = plan.mask.shape
        room = settings.buffer_size, n_obs, n_actions, n_critics
        seen = networks.encoder.sensor
        self.buffer = FrameBuffer(*room, seen) if seen else StageBuffer(*room)
        self.updates = 0

    @property
    def policy_weights(self) -> list[Tensor]:
        """[W1, b1, ...] of the actor, W (n_in, n_out): views, always the newest."""
        return [w[0] for w in self.networks.actor.weights]

    def act(self, obs: Tensor, deterministic: bool) -> Tensor:
        """Actions (n, n_actions) in [-1, 1] of the agent's own dimensions; `obs` (n, n_obs)."""
        mean, log_std = squashed_actor(*self.networks.encoder(self.policy_weights, obs))
        if deterministic:
            return torch.tanh(mean)
        return squashed_sample(mean, log_std, self._noise(mean.shape))[0]

    def train(self, gradient_steps: int, next_agent: SACAgent | None = None) -> None:
        """Algorithm 3, line "training pi_i": `gradient_steps` updates on batches of the buffer.

        `next_agent` is the next stage's, for cooperation (cSAC). Raises `DivergedError` when a loss is not finite.
        """
        following = next_agent.networks if next_agent else None
        for _ in range(gradient_steps):
            batch = self.buffer.sample(self.settings.batch_size, self.generator)
            critic_loss, actor_loss = self._update(batch, following)
            self.updates += 1
        if gradient_steps:
            self._check(float(critic_loss), float(actor_loss))

    def _update(self, batch: Batch, following: SACNetworks | None) -> tuple[Tensor, Tensor]:
        """One step of critics, actor and temperature; the critics' and the actor's loss."""
        networks, engine, n = self.networks, self.engine, len(batch.obs)
        alpha = networks.log_alpha.exp()
        noise = self._noise(torch.Size((2 * n, batch.actions.shape[1])))
        drawn = engine.draw(networks, torch.cat([batch.obs, batch.next_obs]), noise)
        now, then = drawn.rows(slice(n)), drawn.rows(slice(n, None))
        critic_loss = engine.critic_gradient(networks, batch, then, alpha)
        self.critic_optimizer.step()
        actor_loss = engine.actor_gradient(networks, batch.obs, now, alpha, following)
        engine.alpha_gradient(networks, now.log_prob)
        self.actor_optimizer.step()
        networks.targets.flat.lerp_(networks.critics.flat, self.settings.tau)
        return critic_loss, actor_loss

    def _check(self, critic_loss: float, actor_loss: float) -> None:
        """Raise `DivergedError` unless the losses are sane, and finite what was updated last and so entered none."""
        if not abs(critic_loss) + abs(actor_loss) < EXPLODED:  # also when it is not a number
            wrong = f"loss exploded or is not finite (critic {critic_loss:.3g}, actor {actor_loss:.3g})"
        elif not all(bool(torch.isfinite(w).all()) for w in (self.networks.actor.flat, self.networks.log_alpha)):
            wrong = "a weight of the policy or the temperature is not finite"
        else:
            return
        raise DivergedError(f"{wrong} after {self.updates} updates")

    def state(self) -> State:
        """Weights, optimisers, buffer, generator and counts."""
        own: State = {
            "generator": self.generator.get_state(),
            "own_scale": self.networks.own_scale,
            "next_scale": self.networks.next_scale,
            "updates": self.updates,
            "log_alpha": self.networks.log_alpha,
        }
        for name, part in self._parts():
            own |= prefixed(name, part.state())
        for name, optimizer in self._optimizers():
            own |= prefixed(name, optimizer_state(optimizer))
        return own

    def load_state(self, state: State) -> None:
        """Go on from `state`."""
        networks = self.networks
        self.generator.set_state(state["generator"])
        networks.own_scale, networks.next_scale = state["own_scale"], state["next_scale"]
        self.updates = state["updates"]
        networks.log_alpha.copy_(state["log_alpha"])
        for name, part in self._parts():
            part.load_state(below(name, state))
        for name, optimizer in self._optimizers():
            load_optimizer(optimizer, below(name, state))

    def _parts(self) -> tuple[tuple[str, StackedMLP | StageBuffer], ...]:
        networks = self.networks
        return (
            ("actor", networks.actor), ("critics", networks.critics), ("targets", networks.targets),
            ("buffer", self.buffer),
        )  # fmt: skip

    def _optimizers(self) -> tuple[tuple[str, torch.optim.Optimizer], ...]:
        return ("actor_optimizer", self.actor_optimizer), ("critic_optimizer", self.critic_optimizer)

    def _noise(self, shape: torch.Size) -> Tensor:
        return torch.randn(shape, generator=self.generator)
