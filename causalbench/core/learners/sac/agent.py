"""Soft actor-critic for one stage, with the causal policy gradient (paper, sections Causal Policy Gradient, Training).

Haarnoja et al. 2018 with twin critics and a learned temperature, in the order of stable-baselines3's SAC: with one
critic and an all-ones mask losses and gradients are SB3's. What the paper adds is `masked_value`. Gradients are written
out (`StackedMLP`); the tests hold them against SB3's and against finite differences.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.sac.buffer import Batch, StageBuffer
from causalbench.core.learners.sac.frame_buffer import FrameBuffer
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.networks.encoded import Network, network
from causalbench.core.networks.encoder import Encoder
from causalbench.core.networks.squashed_gaussian import (
    LOG_STD_MAX,
    LOG_STD_MIN,
    TANH_EPSILON,
    actor_forward,
    init_actor,
    init_critics,
    squashed_sample,
)
from causalbench.core.networks.state import State, below, load_optimizer, optimizer_state, prefixed
from causalbench.errors import DivergedError

SCALE_DECAY = 0.99  # of the running mean |Q| that cSAC normalises by
LEAST_SCALE = 1e-2
EXPLODED = 1e10  # loss at which training has diverged: values are wrong by about 1e5 stage bonuses


class Drawn(NamedTuple):
    """Actions that the policy drew, with what its gradient needs."""

    layers: list[Tensor]  # of the actor
    noise: Tensor  # (batch, n_actions)
    action: Tensor  # (batch, n_actions)
    log_prob: Tensor  # (batch,)

    def rows(self, rows: slice) -> Drawn:
        """Those of some batch rows."""
        layers = [layer[:, rows] for layer in self.layers]
        return Drawn(layers, self.noise[rows], self.action[rows], self.log_prob[rows])


class SACAgent:
    """The agent A_i of one stage: policy, critics, temperature and buffer."""

    def __init__(self, plan: StagePlan, n_obs: int, settings: SACSettings, seed: int, sensor: str = "") -> None:
        self.plan, self.settings, self.n_obs = plan, settings, n_obs
        self.encoder = encoder = Encoder(sensor)  # one before the actor, one before all critics
        self.generator = torch.Generator().manual_seed(seed)
        n_actions, n_critics = plan.mask.shape
        n_nets, n_heads = (1, n_critics) if settings.critics == "heads" else (n_critics, 1)
        arch, lr = settings.net_arch, settings.learning_rate
        n_seen, kernels = encoder.n_seen(n_obs), encoder.initial_weights(self.generator)
        actor = [*kernels, *init_actor(n_seen, arch, n_actions, self.generator)]
        self.actor = network(encoder, [w[None] for w in actor], n_obs, "relu")
        # Twins of net i are nets i and i + n_nets.
        critics = [w[None] for w in encoder.initial_weights(self.generator)]
        critics += init_critics(2 * n_nets, n_seen + n_actions, arch, n_heads, self.generator)
        self.critics, self.targets = (network(encoder, critics, n_obs, "relu") for _ in range(2))
        self.log_alpha = torch.tensor([math.log(settings.ent_coef_init)])
        self.log_alpha.grad = torch.zeros(1)
        self.actor_optimizer = torch.optim.Adam([self.actor.flat, self.log_alpha], lr, fused=True)
        self.critic_optimizer = torch.optim.Adam([self.critics.flat], lr, fused=True)
        self.target_entropy = -float(n_actions)
        self.mask = torch.from_numpy(plan.mask).to(self.actor.flat.dtype).T.contiguous()  # (n_critics, n_actions)
        self.entropy = torch.from_numpy(plan.entropy).float()[:, None]  # (n_critics, 1)
        room = settings.buffer_size, n_obs, n_actions, n_critics
        self.buffer = FrameBuffer(*room, encoder.sensor) if encoder.sensor else StageBuffer(*room)
        self.own_scale = self.next_scale = 1.0  # running mean |Q| of both critics on this stage's states (cSAC)
        self.updates = 0

    @property
    def policy_weights(self) -> list[Tensor]:
        """[W1, b1, ...] of the actor, W (n_in, n_out): views, always the newest."""
        return [w[0] for w in self.actor.weights]

    def act(self, obs: Tensor, deterministic: bool) -> Tensor:
        """Actions (n, n_actions) in [-1, 1] of the agent's own dimensions; `obs` (n, n_obs)."""
        mean, log_std = actor_forward(*self.encoder(self.policy_weights, obs))
        if deterministic:
            return torch.tanh(mean)
        return squashed_sample(mean, log_std, self._noise(mean.shape))[0]

    def train(self, gradient_steps: int, next_agent: SACAgent | None = None) -> None:
        """Algorithm 3, line "training pi_i": `gradient_steps` updates on batches of the buffer.

        `next_agent` is the next stage's, for cooperation (cSAC). Raises `DivergedError` when a loss is not finite.
        """
        for _ in range(gradient_steps):
            batch = self.buffer.sample(self.settings.batch_size, self.generator)
            alpha = self.log_alpha.exp()
            drawn = self.draw(torch.cat([batch.obs, batch.next_obs]))
            n = len(batch.obs)
            now, following = drawn.rows(slice(n)), drawn.rows(slice(n, None))

            critic_loss = self.critic_gradient(batch, following, alpha)
            self.critic_optimizer.step()
            actor_loss = self.actor_gradient(batch.obs, now, alpha, next_agent)
            self.alpha_gradient(now.log_prob)
            self.actor_optimizer.step()
            self.targets.flat.lerp_(self.critics.flat, self.settings.tau)
            self.updates += 1
        if gradient_steps:
            self._check(float(critic_loss), float(actor_loss))

    def draw(self, obs: Tensor) -> Drawn:
        """Actions tanh(mean + std * noise) of the policy at `obs` (batch, n_obs)."""
        layers = self.actor.forward(obs)
        mean, log_std = layers[-1][0].chunk(2, -1)
        noise = self._noise(mean.shape)
        return Drawn(layers, noise, *squashed_sample(mean, log_std.clamp(LOG_STD_MIN, LOG_STD_MAX), noise))

    def alpha_gradient(self, log_prob: Tensor) -> None:
        """Of the temperature loss -log_alpha * (log_prob + target entropy).

        The target entropy is minus the number of the agent's own actions.
        """
        assert self.log_alpha.grad is not None
        self.log_alpha.grad[0] = -(log_prob.mean() + self.target_entropy)

    def critic_gradient(self, batch: Batch, following: Drawn, alpha: Tensor) -> Tensor:
        """Of half the squared Bellman error, averaged over the batch and summed over all critics; gives that loss."""
        next_q = self._lesser(self._values(self.targets.forward(torch.cat([batch.next_obs, following.action], 1))))[0]
        soft = next_q - self.entropy * (alpha * following.log_prob)
        target = batch.rewards.T + self.settings.gamma * (1 - batch.done) * soft
        layers = self.critics.forward(torch.cat([batch.obs, batch.actions], 1))
        error = self._values(layers) - target
        self.critics.backward(layers, (error / len(batch.obs)).view(layers[-1].mT.shape).mT)
        return 0.5 * error.square().sum() / len(batch.obs)

    def actor_gradient(self, obs: Tensor, drawn: Drawn, alpha: Tensor, next_agent: SACAgent | None = None) -> Tensor:
        """Of the mean of alpha * log_prob - value; gives that loss. The value's gradient is the causal one."""
        value, slope = self.masked_value(obs, drawn.action)
        if next_agent is not None:
            # Erskine and Lehnert 2022, our reading (docs/learners.md): a convex combination of both values in units
            # of their own running size, times this critic's size so that the temperature keeps its meaning.
            share = self.settings.cooperation_weight
            other, other_slope = next_agent.masked_value(obs, drawn.action)
            self.own_scale = _running_scale(self.own_scale, value)
            self.next_scale = _running_scale(self.next_scale, other)
            weight = share * max(self.own_scale, LEAST_SCALE) / max(self.next_scale, LEAST_SCALE)
            value, slope = (1 - share) * value + weight * other, (1 - share) * slope + weight * other_slope
        # action = tanh(x), x = mean + std * noise, log_prob = ... - log_std - log(1 - action^2 + epsilon)
        squash = 1 - drawn.action.square()  # d action / dx
        by_x = (alpha * 2 * drawn.action / (squash + TANH_EPSILON) - slope) * squash / len(obs)
        log_std = drawn.layers[-1][0].chunk(2, -1)[1]
        inside = (log_std >= LOG_STD_MIN) & (log_std <= LOG_STD_MAX)  # the clamp has no slope outside
        by_log_std = (by_x * log_std.exp() * drawn.noise - alpha / len(obs)) * inside
        self.actor.backward(drawn.layers, torch.cat([by_x, by_log_std], 1)[None])
        return (alpha * drawn.log_prob - value).mean()

    def masked_value(self, obs: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """(batch,) sum of the critics, and (batch, n_actions) what each action climbs.

        Paper, eq. of the causal policy gradient: action k climbs just the critics of the rewards that it causes.
        """
        layers = self.critics.forward(torch.cat([obs, action], 1))
        q, twin = self._lesser(self._values(layers))
        n_nets = len(layers[0]) // 2
        slope = torch.zeros(action.shape, dtype=action.dtype)
        for net in range(2 * n_nets):
            critics = slice(net % n_nets, net % n_nets + 1) if n_nets > 1 else slice(None)
            heads, rows = (twin[critics] == net // n_nets).nonzero().unbind(1)
            own = self.critics.input_gradient(layers, net, rows, heads, self.n_obs)
            slope.index_add_(0, rows, own * self.mask[critics].index_select(0, heads))
        return q.sum(0), slope

    def _values(self, layers: list[Tensor]) -> Tensor:
        """(2, n_critics, batch) outputs of both twins."""
        return layers[-1].mT.reshape(2, len(self.mask), -1)

    def _lesser(self, twins: Tensor) -> tuple[Tensor, Tensor]:
        """(n_critics, batch) the lesser twin's value of (2, n_critics, batch), and which of the two it is."""
        if not self.plan.joint_twin:
            return twins.min(0)
        which = twins.sum(1).argmin(0).expand(twins.shape[1:])
        return twins.gather(0, which[None])[0], which

    def _check(self, critic_loss: float, actor_loss: float) -> None:
        """Raise `DivergedError` unless the losses are sane, and finite what was updated last and so entered none."""
        if not abs(critic_loss) + abs(actor_loss) < EXPLODED:  # also when it is not a number
            wrong = f"loss exploded or is not finite (critic {critic_loss:.3g}, actor {actor_loss:.3g})"
        elif not all(bool(torch.isfinite(w).all()) for w in (self.actor.flat, self.log_alpha)):
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
            "log_alpha": self.log_alpha,
        }
        for name, part in self._parts():
            own |= prefixed(name, part.state())
        for name, optimizer in self._optimizers():
            own |= prefixed(name, optimizer_state(optimizer))
        return own

    def load_state(self, state: State) -> None:
        """Go on from `state`."""
        self.generator.set_state(state["generator"])
        self.own_scale, self.next_scale, self.updates = state["own_scale"], state["next_scale"], state["updates"]
        self.log_alpha.copy_(state["log_alpha"])
        for name, part in self._parts():
            part.load_state(below(name, state))
        for name, optimizer in self._optimizers():
            load_optimizer(optimizer, below(name, state))

    def _parts(self) -> tuple[tuple[str, Network | StageBuffer], ...]:
        return ("actor", self.actor), ("critics", self.critics), ("targets", self.targets), ("buffer", self.buffer)

    def _optimizers(self) -> tuple[tuple[str, torch.optim.Optimizer], ...]:
        return ("actor_optimizer", self.actor_optimizer), ("critic_optimizer", self.critic_optimizer)

    def _noise(self, shape: torch.Size) -> Tensor:
        return torch.randn(shape, generator=self.generator)


def _running_scale(scale: float, value: Tensor) -> float:
    return SCALE_DECAY * scale + (1 - SCALE_DECAY) * float(value.abs().mean())
