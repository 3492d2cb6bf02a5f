"""Soft actor-critic for one stage, with the causal policy gradient (paper, sections Causal Policy Gradient, Training).

Haarnoja et al. 2018 with twin critics and a learned temperature, in the order of stable-baselines3's SAC: with one
critic and an all-ones mask losses and gradients are SB3's. What the paper adds is one line of `actor_loss`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from causalbench.core.encoder import Encoder, device_for
from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.frames import FrameBuffer
from causalbench.core.learners.learner import (
    State,
    below,
    load_optimizer,
    load_tensors,
    optimizer_state,
    prefixed,
    tensor_state,
)
from causalbench.core.learners.networks import (
    actor_forward,
    critics_forward,
    init_actor,
    init_critics,
    squashed_sample,
)
from causalbench.core.learners.replay import Batch, StageBuffer
from causalbench.core.learners.settings import SACSettings
from causalbench.errors import DivergedError

SCALE_DECAY = 0.99  # of the running mean |Q| that cSAC normalises by
LEAST_SCALE = 1e-2
EXPLODED = 1e10  # loss at which training has diverged: values are wrong by about 1e5 stage bonuses


class SACAgent:
    """The agent A_i of one stage: policy, critics, temperature and buffer."""

    def __init__(self, plan: StagePlan, n_obs: int, settings: SACSettings, seed: int, sensor: str = "") -> None:
        self.plan, self.settings = plan, settings
        self.encoder, self.device = Encoder(sensor), device_for(sensor)  # one before the actor, one before all critics
        self.generator = torch.Generator().manual_seed(seed)
        n_actions, n_critics = plan.mask.shape
        arch, lr = settings.net_arch, settings.learning_rate
        n_seen = n_obs - self.encoder.n_sensed + self.encoder.n_features
        self.actor = self.encoder.initial_weights(self.generator)
        self.actor += init_actor(n_seen, arch, n_actions, self.generator)
        self.critics = self.encoder.initial_weights(self.generator)
        # Twins are c and c + n_critics.
        self.critics += init_critics(2 * n_critics, n_seen + n_actions, arch, 1, self.generator)
        self.actor, self.critics = ([w.to(self.device) for w in weights] for weights in (self.actor, self.critics))
        self.targets = [w.clone() for w in self.critics]
        self.log_alpha = torch.tensor([math.log(settings.ent_coef_init)], device=self.device)
        for w in (*self.actor, *self.critics, self.log_alpha):
            w.requires_grad_()
        self.actor_optimizer = torch.optim.Adam(self.actor, lr, fused=True)
        self.critic_optimizer = torch.optim.Adam(self.critics, lr, fused=True)
        self.alpha_optimizer = torch.optim.Adam([self.log_alpha], lr)
        self.target_entropy = -float(n_actions)
        self.mask = torch.from_numpy(plan.mask).float().T[:, None, :].to(self.device)  # (n_critics, 1, n_actions)
        self.entropy = torch.from_numpy(plan.entropy).float()[:, None].to(self.device)  # (n_critics, 1)
        room = settings.buffer_size, n_obs, n_actions, n_critics
        self.buffer = FrameBuffer(*room, self.encoder.sensor) if self.encoder.sensor else StageBuffer(*room)
        self.own_scale = self.next_scale = 1.0  # running mean |Q| of both critics on this stage's states (cSAC)
        self.updates = 0

    def act(self, obs: Tensor, deterministic: bool) -> Tensor:
        """Actions (n, n_actions) in [-1, 1] of the agent's own dimensions; `obs` (n, n_obs)."""
        with torch.no_grad():
            mean, log_std = actor_forward(*self.encoder(self.actor, obs.to(self.device)))
            if deterministic:
                return torch.tanh(mean).cpu()
            return squashed_sample(mean, log_std, self._noise(mean.shape))[0].cpu()

    def train(self, gradient_steps: int, next_agent: SACAgent | None = None) -> None:
        """Algorithm 3, line "training pi_i": `gradient_steps` updates on batches of the buffer.

        `next_agent` is the next stage's, for cooperation (cSAC). Raises `DivergedError` when a loss is not finite.
        """
        for _ in range(gradient_steps):
            batch = self.buffer.sample(self.settings.batch_size, self.generator)
            if self.encoder.sensor:
                batch = Batch(*(values.to(self.device) for values in batch))
            noise, next_noise = self._noise(batch.actions.shape), self._noise(batch.actions.shape)
            alpha = self.log_alpha.detach().exp()
            action, log_prob = squashed_sample(*actor_forward(*self.encoder(self.actor, batch.obs)), noise)

            self._descend(self.alpha_optimizer, [self.log_alpha], self.alpha_loss(log_prob.detach()))
            critic_loss = self.critic_loss(batch, alpha, next_noise)
            self._descend(self.critic_optimizer, self.critics, critic_loss)
            actor_loss = self.actor_loss(batch.obs, action, log_prob, alpha, next_agent)
            self._descend(self.actor_optimizer, self.actor, actor_loss)
            with torch.no_grad():
                torch._foreach_lerp_(self.targets, self.critics, self.settings.tau)
            self.updates += 1
        if gradient_steps:
            self._check(float(critic_loss.detach()), float(actor_loss.detach()))

    def _check(self, critic_loss: float, actor_loss: float) -> None:
        """Raise `DivergedError` unless the losses are sane, and finite what was updated last and so entered none."""
        if not abs(critic_loss) + abs(actor_loss) < EXPLODED:  # also when it is not a number
            wrong = f"loss exploded or is not finite (critic {critic_loss:.3g}, actor {actor_loss:.3g})"
        elif not all(bool(torch.isfinite(w).all()) for w in (*self.actor, self.log_alpha)):
            wrong = "a weight of the policy or the temperature is not finite"
        else:
            return
        raise DivergedError(f"{wrong} after {self.updates} updates")

    def state(self) -> State:
        """Weights, optimisers, buffer, generator and counts."""
        own: State = {
            "generator": self.generator.get_state(),
            "own_scale": self.own_scale,
            "next_scale": self.next_scale,
            "updates": self.updates,
        }
        for name, weights, optimizer in self._trained():
            own |= prefixed(name, tensor_state(weights)) | prefixed(f"{name}_optimizer", optimizer_state(optimizer))
        return own | prefixed("targets", tensor_state(self.targets)) | prefixed("buffer", self.buffer.state())

    def load_state(self, state: State) -> None:
        """Go on from `state`."""
        self.generator.set_state(state["generator"])
        self.own_scale, self.next_scale, self.updates = state["own_scale"], state["next_scale"], state["updates"]
        for name, weights, optimizer in self._trained():
            load_tensors(weights, below(name, state))
            load_optimizer(optimizer, below(f"{name}_optimizer", state))
        load_tensors(self.targets, below("targets", state))
        self.buffer.load_state(below("buffer", state))

    def _trained(self) -> tuple[tuple[str, list[Tensor], torch.optim.Optimizer], ...]:
        return (
            ("actor", self.actor, self.actor_optimizer),
            ("critics", self.critics, self.critic_optimizer),
            ("log_alpha", [self.log_alpha], self.alpha_optimizer),
        )

    def alpha_loss(self, log_prob: Tensor) -> Tensor:
        """Temperature loss; the target entropy is minus the number of the agent's own actions."""
        return -(self.log_alpha * (log_prob + self.target_entropy)).mean()

    def critic_loss(self, batch: Batch, alpha: Tensor, next_noise: Tensor) -> Tensor:
        """Half the squared Bellman error, averaged over the batch and summed over all critics."""
        with torch.no_grad():
            policy = actor_forward(*self.encoder(self.actor, batch.next_obs))
            next_action, next_log_prob = squashed_sample(*policy, next_noise)
            targets, next_seen = self.encoder(self.targets, batch.next_obs)
            next_q = self._twin_min(critics_forward(targets, torch.cat([next_seen, next_action], 1)))
            soft = next_q - self.entropy * alpha * next_log_prob
            target = batch.rewards.T + self.settings.gamma * (1 - batch.done) * soft
        critics, seen = self.encoder(self.critics, batch.obs)
        q = critics_forward(critics, torch.cat([seen, batch.actions], 1))
        return 0.5 * (q.view(2, *target.shape) - target).pow(2).mean(-1).sum()

    def actor_loss(
        self, obs: Tensor, action: Tensor, log_prob: Tensor, alpha: Tensor, next_agent: SACAgent | None = None
    ) -> Tensor:
        """Paper, eq. of the causal policy gradient: action k climbs just the critics of the rewards it causes."""
        value = self.masked_value(obs, action)
        if next_agent is not None:
            # Erskine and Lehnert 2022, our reading (docs/learners.md): a convex combination of both values in units
            # of their own running size, times this critic's size so that the temperature keeps its meaning.
            share = self.settings.cooperation_weight
            other = next_agent.masked_value(obs, action)
            self.own_scale = _running_scale(self.own_scale, value)
            self.next_scale = _running_scale(self.next_scale, other)
            scale, other_scale = max(self.own_scale, LEAST_SCALE), max(self.next_scale, LEAST_SCALE)
            value = scale * ((1 - share) * value / scale + share * other / other_scale)
        return (alpha * log_prob - value).mean()

    def masked_value(self, obs: Tensor, action: Tensor) -> Tensor:
        """(batch,) sum of the critics, critic c seeing as constants the actions that do not cause its rewards."""
        with torch.no_grad():  # what the critics see does not depend on the action
            critics, obs = self.encoder(self.critics, obs)
        if bool((self.plan.mask).all()):
            inputs = torch.cat([obs, action], 1)
        else:
            seen = self.mask * action + (1 - self.mask) * action.detach()  # (n_critics, batch, n_actions)
            inputs = torch.cat([obs.expand(len(seen), -1, -1), seen], 2).repeat(2, 1, 1)
        return self._twin_min(critics_forward(critics, inputs)).sum(0)

    def _twin_min(self, q: Tensor) -> Tensor:
        """(n_critics, batch) the lesser twin of (2 * n_critics, batch)."""
        twins = q.view(2, -1, q.shape[-1])
        if not self.plan.joint_twin:
            return twins.amin(0)
        totals = twins.sum(1)
        return torch.where(totals[0] <= totals[1], twins[0], twins[1])

    def _noise(self, shape: torch.Size) -> Tensor:
        return torch.randn(shape, generator=self.generator).to(self.device)

    @staticmethod
    def _descend(optimizer: torch.optim.Optimizer, weights: list[Tensor], loss: Tensor) -> None:
        for w, gradient in zip(weights, torch.autograd.grad(loss, weights), strict=True):
            w.grad = gradient
        optimizer.step()


def _running_scale(scale: float, value: Tensor) -> float:
    return SCALE_DECAY * scale + (1 - SCALE_DECAY) * float(value.detach().abs().mean())
