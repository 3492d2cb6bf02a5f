"""Gradient updates per second of `PPOAgent` beside stable-baselines3's PPO: python benchmarks/ppo_speed.py (2 minutes).

Same networks, batch, passes and losses, one thread each, turns A B A B; figures are medians of turns. The causal rows
are the agents of cmmPPO, averaged over their four stages. Both have two engines, gradients written out and by autograd.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Literal

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from timing import seconds_per_update

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.causal_gradient import stage_plan
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.ppo.agent import PPOAgent
from causalbench.core.learners.ppo.networks import Samples
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.networks.gaussian import gaussian_log_prob
from causalbench.core.tasks.pure_manipulation import TASK

N_OBS, SAMPLES, TURNS = 16, 1024, 7
Engine = Literal["fused", "autograd"]
ENGINES: tuple[Engine, ...] = ("fused", "autograd")
NEVER = 1e9  # a KL at which neither stops early
SETTINGS = (((64, 64), 64, 4), ((64, 64), 256, 8), ((256, 256), 256, 4))  # networks, batch, passes a turn


class Box(gym.Env):
    """Nothing but the spaces that the networks are built from."""

    observation_space = gym.spaces.Box(-1, 1, (N_OBS,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (len(TASK.actions),), np.float32)


def sb3(net_arch: tuple[int, ...], batch_size: int, passes: int) -> Callable[[], None]:
    """Stock PPO with a full rollout; a function that does `passes` passes over it."""
    model = PPO(
        "MlpPolicy", Box(), n_steps=SAMPLES, batch_size=batch_size, n_epochs=passes, target_kl=NEVER, seed=0,
        device="cpu", policy_kwargs={"net_arch": list(net_arch)},
    )  # fmt: skip
    model.set_logger(configure(None, []))
    model._current_progress_remaining = 1.0
    rng, buffer = np.random.default_rng(0), model.rollout_buffer
    for store in (buffer.observations, buffer.actions, buffer.advantages, buffer.returns):
        store[:] = rng.standard_normal(store.shape)
    with torch.no_grad():
        obs, actions = (torch.from_numpy(store[:, 0]) for store in (buffer.observations, buffer.actions))
        buffer.log_probs[:, 0] = model.policy.evaluate_actions(obs, actions)[1].numpy()
    buffer.full = True
    return model.train


def ours(
    name: str, stage: int, net_arch: tuple[int, ...], batch_size: int, passes: int, engine: Engine = "fused"
) -> Callable[[], None]:
    """One stage's agent of a method with as many samples; a function that does `passes` passes over them."""
    method = next(m for m in METHODS if m.name == name)
    graph = manual_graph(TASK) if method.matrix == "manual" else None
    settings = PPOSettings(net_arch=net_arch, batch_size=batch_size, n_epochs=passes, target_kl=NEVER, engine=engine)
    agent = PPOAgent(stage_plan(TASK, method, graph, stage), N_OBS, settings, seed=0)
    generator = torch.Generator().manual_seed(0)
    networks = agent.networks
    n_critics, n_actions = networks.mask.shape
    obs, actions, advantages, returns = (
        torch.randn(SAMPLES, n, generator=generator) for n in (N_OBS, n_actions, n_critics, n_critics)
    )
    log_prob = gaussian_log_prob(networks.mean.forward(obs).outputs[0], networks.log_std, actions)
    samples = Samples(obs, actions, log_prob, advantages, returns)

    def train() -> None:
        agent.samples = samples  # an agent uses its samples up
        agent.train()

    return train


def main() -> None:
    """Print one block per network and batch size."""
    torch.set_num_threads(1)
    for net_arch, batch_size, passes in SETTINGS:
        size = (net_arch, batch_size, passes)
        rivals = {"SB3 PPO": sb3(*size)}
        for engine in ENGINES:
            rivals[f"mPPO {engine}"] = ours("mPPO", 1, *size, engine)
            rivals |= {f"cmmPPO {engine} {i}": ours("cmmPPO", i, *size, engine) for i in (1, 2, 3, 4)}
        medians = seconds_per_update(rivals, passes * SAMPLES // batch_size, TURNS)
        stock = medians["SB3 PPO"]
        print(f"networks {net_arch}, batch {batch_size}: SB3's PPO {1 / stock:.0f} updates/s; shares of its rate")
        for row, label in (("mPPO", "mPPO, all actions"), ("cmmPPO", "cmmPPO, mean of stages")):
            means = [
                statistics.mean(v for name, v in medians.items() if name.startswith(f"{row} {e}")) for e in ENGINES
            ]
            fused, autograd = means
            print(f"  {label:24} fused {stock / fused:.2f}, autograd {stock / autograd:.2f}", end="; ")
            print(f"fused is {autograd / fused:.2f} times as fast as autograd")


if __name__ == "__main__":
    main()
