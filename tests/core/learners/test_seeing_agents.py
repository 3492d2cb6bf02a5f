"""Agents with the paper's convolutions: stable-baselines3's updates, training, checkpoints, policies."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from agents import plan
from core.networks.test_encoder import reference
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from training import METHOD, train

import causalbench
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.kinematic import make
from causalbench.core.learners.checkpoint import Checkpoints
from causalbench.core.learners.policy import ObservationScale
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.sac.agent import SACAgent
from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.networks.encoder import SENSORS, Encoder
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.errors import DivergedError, UserError

N_STATE, N_ACTIONS, BATCH = 4, 2, 6
SMALL = SACSettings(net_arch=(16,), batch_size=BATCH, learning_rate=3e-4, buffer_size=20)


class Extractor(BaseFeaturesExtractor):
    """State and convolutions, by torch's own modules."""

    def __init__(self, space: gym.spaces.Box, name: str) -> None:
        super().__init__(space, N_STATE + Encoder(name).n_features)
        self.sensor, self.network = SENSORS[name], reference(name)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        sensed = inputs[:, N_STATE:].reshape(-1, *self.sensor.shape).movedim(-1, 1) / self.sensor.full
        return torch.cat([inputs[:, :N_STATE], self.network(sensed)], 1)


def parameters(agent: SACAgent) -> list[list[torch.Tensor]]:
    """Actor, critics and targets, the encoders and the actor without their leading dimension; views."""
    n, nets = agent.networks.encoder.n_weights, (agent.networks.critics, agent.networks.targets)
    sides = [[*(w[0] for w in net.weights[:n]), *net.weights[n:]] for net in nets]
    return [agent.policy_weights, *sides]


def sb3_parameters(model: SAC) -> tuple[list[torch.Tensor], list[torch.Tensor], list[torch.Tensor]]:
    """Actor, critics and targets of SB3 in our order, transposed and twins together; views where that is possible."""
    actor, critics, targets = model.actor, model.critic, model.critic_target

    def linears(module: torch.nn.Module) -> list[torch.nn.Linear]:
        return [layer for layer in module.modules() if isinstance(layer, torch.nn.Linear)]

    first = [*actor.features_extractor.parameters()]
    first += [t for layer in linears(actor.latent_pi) for t in (layer.weight.T, layer.bias)]
    heads = actor.mu, actor.log_std
    first += [torch.cat([h.weight for h in heads]).T, torch.cat([h.bias for h in heads])]
    sides = []
    for network in (critics, targets):
        pairs = zip(linears(network.qf0), linears(network.qf1), strict=True)
        stacked = [t for a, b in pairs for t in (torch.stack([a.weight.T, b.weight.T]), torch.stack([a.bias, b.bias]))]
        sides.append([*network.features_extractor.parameters(), *stacked])
    return first, sides[0], sides[1]


@pytest.mark.parametrize("engine", ["fused", "autograd"])
@pytest.mark.parametrize("name", SENSORS)
def test_one_critic_and_an_all_ones_matrix_is_sb3s_sac_with_such_an_extractor(
    engine: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SB3 has one extractor for the actor and one for both critics, too.

    After gradient descent at rate 1 weights differ from the start by exactly the gradients.
    """
    n_obs, settings = N_STATE + SENSORS[name].size, dataclasses.replace(SMALL, engine=engine)
    agent = SACAgent(plan(np.ones((N_ACTIONS, 1))), n_obs, settings, seed=3, sensor=name)
    networks = agent.networks

    class Env(gym.Env):
        observation_space = gym.spaces.Box(-300, 300, (n_obs,), np.float32)
        action_space = gym.spaces.Box(-1, 1, (N_ACTIONS,), np.float32)

    kwargs = {
        "net_arch": list(SMALL.net_arch),
        "features_extractor_class": Extractor,
        "features_extractor_kwargs": {"name": name},
        "optimizer_class": torch.optim.SGD,
    }
    model = SAC(
        "MlpPolicy", Env(), learning_rate=1.0, batch_size=BATCH, ent_coef=f"auto_{SMALL.ent_coef_init}",
        policy_kwargs=kwargs, device="cpu", seed=0, buffer_size=1,
    )  # fmt: skip
    model.set_logger(configure(None, []))
    model._current_progress_remaining = 1.0
    with torch.no_grad():
        for weights, theirs in zip(parameters(agent), sb3_parameters(model), strict=True):
            for w, their in zip(weights, theirs, strict=True):
                assert w.shape == their.shape
                w.copy_(their)
    g = torch.Generator().manual_seed(0)
    sensed = [torch.rand(BATCH, SENSORS[name].size, generator=g) * SENSORS[name].full for _ in range(2)]
    obs, next_obs = (torch.cat([torch.randn(BATCH, N_STATE, generator=g), s], 1) for s in sensed)
    actions, rewards = torch.rand(BATCH, N_ACTIONS, generator=g) * 2 - 1, torch.randn(BATCH, 1, generator=g)
    batch = Batch(obs, actions, rewards, next_obs, torch.tensor([0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
    samples = ReplayBufferSamples(obs, actions, next_obs, batch.done[:, None], rewards)
    monkeypatch.setattr(model.replay_buffer, "sample", lambda *a, **k: samples)
    monkeypatch.setattr(agent.buffer, "sample", lambda *a, **k: batch)
    noise = [torch.randn(BATCH, N_ACTIONS, generator=g) for _ in range(2)]
    theirs_noise = iter(noise)
    monkeypatch.setattr(agent, "_noise", lambda shape: torch.cat(noise))
    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *a, **k: next(theirs_noise))
    agent.actor_optimizer = torch.optim.SGD([networks.actor.flat, networks.log_alpha], 1.0)
    agent.critic_optimizer = torch.optim.SGD([networks.critics.flat], 1.0)
    monkeypatch.setattr(model, "_update_learning_rate", lambda optimizers: None)
    before = [w.clone() for w in networks.actor.weights]
    agent.train(1)
    model.train(gradient_steps=1, batch_size=BATCH)
    for weights, theirs in zip(parameters(agent), sb3_parameters(model), strict=True):
        for w, their in zip(weights, theirs, strict=True):
            torch.testing.assert_close(w, their.detach(), atol=1e-5, rtol=1e-5)
    assert all(not torch.equal(w, old) for w, old in zip(networks.actor.weights, before, strict=True))


SEES = {
    "SAC": SACSettings(net_arch=(8,), batch_size=8, learning_starts=16, train_every=16, buffer_size=100, n_envs=2,
                       observation="paper", observe_gripper=False),
    "PPO": PPOSettings(net_arch=(8,), batch_size=16, n_steps=60, n_epochs=1, n_envs=2, observation="paper"),
}  # fmt: skip
LOOKS = EvaluationSettings(every=1_000, episodes=1, final_episodes=1)
QUICK = {task.name: dataclasses.replace(task, horizon=20) for task in (PURE, MOBILE)}


class Kill(Exception):  # noqa: N818 - it stands for a SIGKILL
    """Ends training in its middle."""


def run(task_name: str, method: str, path: Path | None = None, kill_at: int = -1):
    """Train for 160 steps, killed at a step of this call."""
    task, steps = QUICK[task_name], 0

    def on_progress(share: float, text: str) -> None:
        nonlocal steps
        steps += 1
        if steps == kill_at:
            raise Kill

    def make_scene():
        return make(mobile=task_name == "mobile_manipulation")

    return train(
        task, make_scene, METHOD[method], manual_graph(task), SEES[METHOD[method].learner], LOOKS, 160,
        on_progress=on_progress, checkpoints=path and Checkpoints(path, every=30),
    )  # fmt: skip


def flat(policy) -> torch.Tensor:
    return torch.cat([w.detach().flatten() for actor in policy.actors for w in actor])


@pytest.mark.parametrize(
    ("task_name", "method"),
    [
        ("pure_manipulation", "cmmSAC"),
        ("mobile_manipulation", "cmmPPO"),
        pytest.param("pure_manipulation", "cmmPPO", marks=pytest.mark.long),
        pytest.param("mobile_manipulation", "cSAC", marks=pytest.mark.long),
    ],
)
def test_it_trains_is_killed_and_continues_and_its_policy_is_read_back(
    task_name: str, method: str, tmp_path: Path
) -> None:
    policy, counts = run(task_name, method)
    assert counts.updates[1] > 0
    path = tmp_path / "checkpoint.safetensors"
    with pytest.raises(Kill):
        run(task_name, method, path, kill_at=50)
    assert path.exists()
    continued, _ = run(task_name, method, path)
    assert torch.equal(flat(continued), flat(policy))
    policy.save(tmp_path / "policy")
    again = causalbench.load_policy(tmp_path / "policy")
    task = QUICK[task_name]
    worlds = SceneWorlds(task, make(mobile=task_name == "mobile_manipulation"))
    env = StageTaskEnv(worlds, observe_gripper=method.endswith("PPO"), observe="paper")
    obs, _ = env.reset(seed=0)
    action, _ = again.predict(obs)
    np.testing.assert_array_equal(action, policy.predict(obs)[0])
    sensor = task.paper_sensor
    changed, _ = again.predict(obs | {sensor: np.flip(obs[sensor], 0).copy()})
    assert not np.array_equal(action, changed)


def test_scaling_leaves_the_sensor_to_the_encoder() -> None:
    env = StageTaskEnv(SceneWorlds(PURE, make()), observe="paper")
    obs, _ = env.reset(seed=0)
    scale = ObservationScale.of(env.observation_space, PURE, "paper")
    inputs = scale({k: np.asarray(v)[None] for k, v in obs.items()})
    assert inputs.shape == (1, scale.n_inputs) == (1, 22 + 9216)
    assert torch.equal(inputs[0, 22:], torch.from_numpy(obs["rgb"]).flatten().float())


def test_a_number_that_is_none_in_the_image_ends_training_as_diverged(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = SACAgent(plan(np.ones((2, 1))), N_STATE + SENSORS["lidar"].size, SMALL, seed=0, sensor="lidar")
    obs = torch.zeros(4, N_STATE + SENSORS["lidar"].size)
    obs[0, -1] = torch.nan
    agent.buffer.add(Batch(obs, torch.zeros(4, 2), torch.zeros(4, 1), obs.clone(), torch.zeros(4)))
    with pytest.raises(DivergedError, match="not finite"):
        agent.train(3)


def test_stable_baselines3s_own_rows_refuse_it() -> None:
    with pytest.raises(UserError, match="'SAC' has no convolutions"):
        train(PURE, make, METHOD["SAC"], None, SEES["SAC"], LOOKS, 10)
