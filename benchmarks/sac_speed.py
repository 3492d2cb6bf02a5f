"""Gradient updates per second of `SACAgent` beside stable-baselines3's SAC: python benchmarks/sac_speed.py (2 minutes).

Same networks, batch size, update ratio and losses, one thread each, turns A B A B; figures are medians of turns. The
causal rows are the agents of cmmSAC, averaged over their four stages; their critics are one per distinct matrix row.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import partial

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from timing import seconds_per_update

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.causal_gradient import stage_plan
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.sac_agent import SACAgent
from causalbench.core.learners.settings import SACSettings
from causalbench.core.tasks.pure_manipulation import TASK

N_OBS, SAMPLES, TURNS = 16, 10_000, 7
SETTINGS = (((64, 64), 256, 60), ((256, 256), 256, 20), ((512, 512), 512, 6))  # networks, batch, updates a turn


class Box(gym.Env):
    """Nothing but the spaces that the networks are built from."""

    observation_space = gym.spaces.Box(-1, 1, (N_OBS,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (len(TASK.actions),), np.float32)


def sb3(net_arch: tuple[int, ...], batch_size: int) -> Callable[[int], None]:
    """Stock SAC with a full buffer; a function that does n updates."""
    model = SAC(
        "MlpPolicy", Box(), batch_size=batch_size, buffer_size=SAMPLES, seed=0, device="cpu",
        policy_kwargs={"net_arch": list(net_arch)},
    )  # fmt: skip
    model.set_logger(configure(None, []))
    rng, buffer = np.random.default_rng(0), model.replay_buffer
    for store in (buffer.observations, buffer.next_observations, buffer.rewards):
        store[:] = rng.standard_normal(store.shape)
    buffer.actions[:] = rng.uniform(-1, 1, buffer.actions.shape)
    buffer.full = True
    model._current_progress_remaining = 1.0
    return lambda n: model.train(gradient_steps=n, batch_size=batch_size)


def ours(name: str, stage: int, net_arch: tuple[int, ...], batch_size: int) -> Callable[[int], None]:
    """One stage's agent of a method with a full buffer; a function that does n updates."""
    method = next(m for m in METHODS if m.name == name)
    graph = manual_graph(TASK) if method.matrix == "manual" else None
    settings = SACSettings(net_arch=net_arch, batch_size=batch_size, buffer_size=SAMPLES)
    agent = SACAgent(stage_plan(TASK, method, graph, stage), N_OBS, settings, seed=0)
    generator = torch.Generator().manual_seed(0)
    for store in agent.buffer.data:
        store.copy_(torch.rand(store.shape, generator=generator) * 2 - 1)
    agent.buffer.size = SAMPLES
    return agent.train


def main() -> None:
    """Print one block per network size."""
    torch.set_num_threads(1)
    for net_arch, batch_size, updates in SETTINGS:
        rivals = {"SB3 SAC": sb3(net_arch, batch_size), "mSAC": ours("mSAC", 1, net_arch, batch_size)}
        rivals |= {f"cmmSAC stage {i}": ours("cmmSAC", i, net_arch, batch_size) for i in (1, 2, 3, 4)}
        work = {name: partial(train, updates) for name, train in rivals.items()}
        medians = seconds_per_update(work, updates, TURNS)
        causal = statistics.mean(value for name, value in medians.items() if name.startswith("cmm"))
        stock = medians["SB3 SAC"]
        print(f"networks {net_arch}, batch {batch_size}: SB3's SAC {1 / stock:.0f} updates/s")
        print(f"  mSAC, identical math     {stock / medians['mSAC']:.2f} of SB3's rate")
        print(f"  cmmSAC, mean over stages {stock / causal:.2f}")


if __name__ == "__main__":
    main()
