"""The gradients written out against those that autograd finds for the losses one reads, on every plan."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import torch
from agents import FORMS, Form

from causalbench.core.learners.ppo import agent as ppo
from causalbench.core.learners.ppo.networks import Samples
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.sac import agent as sac
from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.networks.encoder import SENSORS, Encoder
from causalbench.core.networks.squashed_gaussian import LOG_STD_MAX

ENGINES = ("fused", "autograd")
N_STATE, BATCH, UPDATES = 4, 8, 5
SAC = SACSettings(net_arch=(16, 16), batch_size=BATCH, learning_rate=3e-4, buffer_size=40)
PPO = PPOSettings(net_arch=(16, 16), batch_size=BATCH, learning_rate=3e-4, n_epochs=2, ent_coef=0.01, target_kl=1e9)

every_sensor = pytest.mark.parametrize("sensor", ["", *SENSORS], ids=["state", *SENSORS])
every_form = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
alone_or_together = pytest.mark.parametrize("cooperates", [False, True], ids=["alone", "cooperates"])
ppo_form = pytest.mark.parametrize("form", [f for f in FORMS.values() if f.critics != "heads"],
                                   ids=[name for name, f in FORMS.items() if f.critics != "heads"])  # fmt: skip


def observations(n: int, sensor: str, generator: torch.Generator) -> torch.Tensor:
    state = torch.randn(n, N_STATE, generator=generator)
    if not sensor:
        return state
    sensed = torch.rand(n, SENSORS[sensor].size, generator=generator) * SENSORS[sensor].full
    return torch.cat([state, sensed.to(SENSORS[sensor].dtype).to(state.dtype)], 1)


def sac_agent(form: Form, sensor: str, engine: Any, seed: int = 3) -> sac.SACAgent:
    settings = dataclasses.replace(SAC, critics=form.critics, engine=engine)
    return sac.SACAgent(form.plan, N_STATE + Encoder(sensor).n_sensed, settings, seed, sensor)


def transitions(n: int, form: Form, sensor: str) -> Batch:
    g = torch.Generator().manual_seed(0)
    n_actions, n_critics = form.plan.mask.shape
    return Batch(
        observations(n, sensor, g),
        torch.rand(n, n_actions, generator=g) * 2 - 1,
        torch.randn(n, n_critics, generator=g),
        observations(n, sensor, g),
        (torch.rand(n, generator=g) < 0.2).to(torch.get_default_dtype()),
    )


@every_form
@every_sensor
@alone_or_together
@pytest.mark.usefixtures("double_precision")
def test_sacs_gradients_and_losses_are_the_same(form: Form, sensor: str, cooperates: bool) -> None:
    """Of critics, actor and temperature, with a log std beyond its bounds and clamped among them."""
    batch, n_actions = transitions(BATCH, form, sensor), len(form.plan.mask)
    noise = torch.randn(2 * BATCH, n_actions, generator=torch.Generator().manual_seed(5))
    alpha, found = torch.tensor([0.3]), []
    for engine in ENGINES:
        agent, other = (sac_agent(form, sensor, engine, seed) for seed in (3, 4))
        networks, gradients = agent.networks, agent.engine
        networks.log_alpha = networks.log_alpha.double()
        networks.log_alpha.grad = torch.zeros(1)
        log_std = networks.actor.forward(batch.obs).outputs[0, :, -1]
        networks.actor.weights[-1][0, -1] += LOG_STD_MAX - log_std.median()  # half of them beyond it
        drawn = gradients.draw(networks, torch.cat([batch.obs, batch.next_obs]), noise)
        now, then = drawn.rows(slice(BATCH)), drawn.rows(slice(BATCH, None))
        following = other.networks if cooperates else None
        losses = gradients.critic_gradient(networks, batch, then, alpha), gradients.actor_gradient(
            networks, batch.obs, now, alpha, following
        )  # fmt: skip
        gradients.alpha_gradient(networks, now.log_prob)
        assert networks.log_alpha.grad.item() != 0
        assert (networks.own_scale != 1.0) == cooperates
        scales = torch.tensor([networks.own_scale, networks.next_scale])
        sides = [*networks.critics.gradients, *networks.actor.gradients, networks.log_alpha.grad]
        found.append([*losses, scales, *sides])
    for fused, autograd in zip(*found, strict=True):
        assert fused.dtype == torch.float64
        assert not torch.equal(fused, torch.zeros_like(fused))
        torch.testing.assert_close(fused, autograd, atol=1e-9, rtol=1e-6)


@every_form
@every_sensor
@alone_or_together
def test_sac_trains_the_same_weights(form: Form, sensor: str, cooperates: bool) -> None:
    trained = []
    for engine in ENGINES:
        agent, other = (sac_agent(form, sensor, engine, seed) for seed in (3, 4))
        for one in (agent, other):
            one.buffer.add(transitions(40, form, sensor))
        for _ in range(UPDATES):
            agent.train(1, other if cooperates else None)
            other.train(1)
        networks = agent.networks
        trained.append([networks.actor.flat, networks.critics.flat, networks.targets.flat, networks.log_alpha])
    for fused, autograd in zip(*trained, strict=True):
        torch.testing.assert_close(fused, autograd, atol=1e-5, rtol=1e-5)


def ppo_agent(form: Form, sensor: str, engine: Any) -> ppo.PPOAgent:
    """With a policy that depends on the state: the initial one hardly does."""
    settings = dataclasses.replace(PPO, engine=engine)
    agent = ppo.PPOAgent(form.plan, N_STATE + Encoder(sensor).n_sensed, settings, 3, sensor)
    agent.networks.mean.weights[-2].mul_(50)
    return agent


def samples(agent: ppo.PPOAgent, n: int, sensor: str) -> Samples:
    """Of a policy that has since moved, so that some ratios are clipped."""
    g = torch.Generator().manual_seed(0)
    n_critics, n_actions = agent.networks.mask.shape
    obs = observations(n, sensor, g)
    actions = agent.act(obs)
    nothing = Samples(obs, actions, torch.zeros(n, n_actions), *(torch.randn(n, n_critics, generator=g) for _ in "ab"))
    log_prob = agent.engine.judge(agent.networks, nothing).log_ratio.detach()
    return nothing._replace(log_prob=log_prob + 0.3 * torch.randn(n, n_actions, generator=g))


@ppo_form
@every_sensor
@pytest.mark.usefixtures("double_precision")
def test_ppos_gradients_and_losses_are_the_same(form: Form, sensor: str) -> None:
    """Of mean, log std and values, with ratios that are clipped on either side among them, and with entropy."""
    found = []
    for engine in ENGINES:
        agent = ppo_agent(form, sensor, engine)
        networks, batch = agent.networks, samples(agent, 4 * BATCH, sensor)
        judged = agent.engine.judge(networks, batch)
        ratio = judged.log_ratio.exp()
        assert (ratio < 0.8).any()
        assert (ratio > 1.2).any()
        losses = agent.engine.policy_gradient(networks, batch, judged), agent.engine.value_gradient(networks, batch)
        sides = [*networks.mean.gradients, networks.log_std.grad, *networks.values.gradients]
        found.append([*losses, *sides])
    for fused, autograd in zip(*found, strict=True):
        assert fused.dtype == torch.float64
        assert not torch.equal(fused, torch.zeros_like(fused))
        torch.testing.assert_close(fused, autograd, atol=1e-9, rtol=1e-6)


@ppo_form
@every_sensor
def test_ppo_trains_the_same_weights(form: Form, sensor: str) -> None:
    trained = []
    for engine in ENGINES:
        agent = ppo_agent(form, sensor, engine)
        agent.samples = samples(agent, 3 * BATCH, sensor)
        agent.train()
        assert agent.updates == 6
        trained.append(agent.networks.blocks)
    for fused, autograd in zip(*trained, strict=True):
        torch.testing.assert_close(fused, autograd, atol=1e-5, rtol=1e-5)
