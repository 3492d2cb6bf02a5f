"""Gradient updates per second of `SACAgent` beside stable-baselines3's SAC: python benchmarks/sac_speed.py (2 minutes).

Same networks, batch size, update ratio and losses, one thread each, turns A B A B; figures are medians of processor
time. The causal rows are the agents of cmmSAC, averaged over their four stages, with one critic per distinct matrix row
as networks of their own ("rows") and as heads of one network ("heads"). Each has both engines, gradients written out
and by autograd. The peak is a 512 x 512 x 512 product's.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Literal

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from timing import seconds_per_update

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.causal_gradient import stage_plan
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.sac.agent import SACAgent
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.settings import CriticLayout
from causalbench.core.tasks.pure_manipulation import TASK

N_OBS, SAMPLES, TURNS = 16, 10_000, 7
SIDE = 512  # of the matrices that show the core's peak
CAUSAL: tuple[CriticLayout, ...] = ("rows", "heads")
Engine = Literal["fused", "autograd"]
ENGINES: tuple[Engine, ...] = ("fused", "autograd")
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


def ours(
    name: str,
    stage: int,
    net_arch: tuple[int, ...],
    batch_size: int,
    critics: CriticLayout = "rows",
    engine: Engine = "fused",
) -> Callable[[int], None]:
    """One stage's agent of a method with a full buffer; a function that does n updates."""
    method = next(m for m in METHODS if m.name == name)
    graph = manual_graph(TASK) if method.matrix == "manual" else None
    settings = SACSettings(
        net_arch=net_arch, batch_size=batch_size, buffer_size=SAMPLES, critics=critics, engine=engine
    )
    agent = SACAgent(stage_plan(TASK, method, graph, stage, critics), N_OBS, settings, seed=0)
    generator = torch.Generator().manual_seed(0)
    for store in agent.buffer.data:
        store.copy_(torch.rand(store.shape, generator=generator) * 2 - 1)
    agent.buffer.size = SAMPLES
    return agent.train


def multiply(n: int) -> None:
    """Matrix products at the core's peak."""
    a, b = torch.ones(2, SIDE, SIDE)
    product = torch.empty(SIDE, SIDE)
    for _ in range(n):
        torch.mm(a, b, out=product)


def operations(net_arch: tuple[int, ...], batch_size: int) -> float:
    """Floating-point operations of the matrix products of one plain update, the actor's slope by lesser twins alone."""

    def forward(*sizes: int) -> float:
        return 2.0 * batch_size * sum(a * b for a, b in pairwise(sizes))

    n_actions = len(TASK.actions)
    critic = forward(N_OBS + n_actions, *net_arch, 1)
    critic_backward = 2 * critic - forward(N_OBS + n_actions, net_arch[0])  # no gradient by the samples
    actor = forward(N_OBS, *net_arch, 2 * n_actions)
    actor_backward = 2 * actor - forward(N_OBS, net_arch[0])
    # Targets, critics and their gradient, critics of the new actions, one slope a sample; the actor at s and s'.
    return 2 * critic + 2 * (critic + critic_backward) + 2 * critic + critic + 2 * actor + actor_backward


def main() -> None:
    """Print one block per network size."""
    torch.set_num_threads(1)
    for net_arch, batch_size, updates in SETTINGS:
        size = (net_arch, batch_size)
        rivals = {"SB3 SAC": sb3(*size)}
        for engine in ENGINES:
            rivals[f"mSAC {engine}"] = ours("mSAC", 1, *size, engine=engine)
            for critics in CAUSAL:
                rivals |= {f"{critics} {engine} {i}": ours("cmmSAC", i, *size, critics, engine) for i in (1, 2, 3, 4)}
        work: dict[str, Callable[[], object]] = {name: partial(train, updates) for name, train in rivals.items()}
        work["product"] = partial(multiply, updates)
        medians = seconds_per_update(work, updates, TURNS)
        stock = medians["SB3 SAC"]
        peak = 2 * SIDE**3 / medians["product"]
        share = operations(*size) / medians["mSAC fused"] / peak
        print(f"networks {net_arch}, batch {batch_size}: SB3's SAC {1 / stock:.0f} updates/s; shares of its rate")
        for row in ("mSAC", *CAUSAL):
            means = [
                statistics.mean(v for name, v in medians.items() if name.startswith(f"{row} {e}")) for e in ENGINES
            ]
            fused, autograd = means
            label = "mSAC, identical maths" if row == "mSAC" else f"cmmSAC {row}, mean of stages"
            print(f"  {label:30} fused {stock / fused:.2f}, autograd {stock / autograd:.2f}", end="; ")
            print(f"fused is {autograd / fused:.2f} times as fast as autograd")
        print(f"  mSAC fused reaches {share:.0%} of one core's {peak / 1e9:.0f} GFLOP/s")


if __name__ == "__main__":
    main()
