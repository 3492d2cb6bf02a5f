"""Fitting reward models: our batched fit against the straightforward loop, in one process, A B A B.

    python benchmarks/discovery_speed.py

Two factors that are never to be multiplied: pair samples a second at equal samples seen (one nn.Module and DataLoader
per pair at batch 32 against all pairs side by side), and samples that a pair sees until training stops early on the
default's sets against the paper's 100 epochs on its own, with the wrong cells of both beside it, both by the batched
fit. Kinematic, stage 2, whose causes are known. Takes three minutes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, TensorDataset

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.methods.kl.method import discover_stage
from causalbench.core.discovery.reward_model.fit import HELD_OUT, train_reward_models
from causalbench.core.discovery.samples.collect import collect
from causalbench.core.discovery.samples.transitions import Samples, StageSamples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.kinematic import make
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.batch import make_batch
from causalbench.core.world.scene import Scene

STAGE, ROUNDS = 2, 5
CAUSES = {"r_ori": {"armrx", "armry"}, "r_gripper": {"grip"}}
LITERAL = DISCOVERERS["kl"].configure("paper")
OURS = DISCOVERERS["kl"].configure("quick", {"n_placebos": 0})
COUNT = LITERAL.training_count  # collected; ours are the first of them


class RewardModel(nn.Module):
    """One pair's network, as the paper's appendix has it."""

    def __init__(self, n_inputs: int) -> None:
        super().__init__()
        layers = [nn.Linear(n_inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU()]
        self.body, self.mean, self.log_sigma = nn.Sequential(*layers), nn.Linear(128, 1), nn.Linear(128, 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and log sigma (n, 1)."""
        hidden = self.body(x)
        return self.mean(hidden), self.log_sigma(hidden).clamp(-4.6, 4.0)


@dataclass(frozen=True)
class Subset:
    """The `StageProblem` of the first `training_count` samples of each set of one stage."""

    task: StageTask
    stage: int
    settings: DiscoverySettings
    seed: int
    whole: StageSamples

    @property
    def options(self) -> Any:
        """The discoverer's own."""
        return self.settings.options

    @property
    def terms(self) -> tuple[str, ...]:
        """The stage's."""
        return self.task.stage_terms(self.stage, discoverable_only=True)

    def samples(self) -> StageSamples:
        """Nested: what a smaller `training_count` holds, a larger one holds, too."""
        count = self.settings.training_count
        inference = self.whole.inference.first(round(self.settings.inference_fraction * count))
        interventions = tuple(samples.first(count) for samples in self.whole.interventions)
        extra = self.whole.extra and self.whole.extra.first(count)
        return StageSamples(self.whole.random.first(count), inference, interventions, extra)

    def scene(self) -> Scene:
        """Samples are all there is."""
        raise NotImplementedError

    def walk(self, rng: np.random.Generator) -> Walk:
        """Nor is there a walk."""
        raise NotImplementedError

    def keep(self, name: str, samples: Samples) -> None:
        """Nothing is kept."""

    def report(self, share: float, doing: str) -> None:
        """No progress."""


def gather() -> StageSamples:
    """D_random, D_inference and every D_do of the stage."""
    batch = make_batch(make, 16)

    def one(stream: int, count: int, do: int | None) -> Samples:
        rng = np.random.default_rng([0, STAGE, stream])
        return collect(SceneWorlds(TASK, batch), STAGE, count, do, rng, 10, 0, lambda n: None)

    interventions = tuple(one(2 + k, COUNT, k) for k in range(len(TASK.actions)))
    return StageSamples(one(0, COUNT, None), one(1, COUNT // 5, None), interventions)


def pairs_of(data: StageSamples) -> list[tuple[Samples, Samples]]:
    """(D_random, D_do[a_k]) of every action."""
    return [(data.random, do) for do in data.interventions]


def loop_rate(data: StageSamples, k: int) -> float:
    """Pair samples a second of one epoch of one pair, the straightforward way."""
    both = (data.random, data.interventions[k])
    x = np.concatenate([np.concatenate([s.states, s.actions], axis=1) for s in both])
    y = np.concatenate([s.rewards[:, :1] for s in both])
    dataset = TensorDataset(torch.from_numpy((x - x.mean(0)) / (x.std(0) + 1e-6)), torch.from_numpy(y / y.std()))
    model = RewardModel(x.shape[1])
    optimizer = torch.optim.Adam(model.parameters(), LITERAL.options.learning_rate)
    started = time.perf_counter()
    for inputs, target in DataLoader(dataset, LITERAL.options.batch_size, shuffle=True):
        mean, log_sigma = model(inputs)
        loss = (0.5 * ((target - mean) / log_sigma.exp()) ** 2 + log_sigma).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return len(x) / (time.perf_counter() - started)


def batched_rate(data: StageSamples, epochs: int) -> float:
    """Pair samples a second of `epochs` epochs of all pairs together, early stopping off."""
    started = time.perf_counter()
    train_reward_models(pairs_of(data), replace(OURS.options, patience=0, max_epochs=epochs), 0, lambda share: None)
    pairs = len(data.interventions) * data.random.rewards.shape[1]
    return pairs * 2 * COUNT * epochs / (time.perf_counter() - started)


def wrong_cells(data: StageSamples, settings: DiscoverySettings) -> tuple[int, float]:
    """Cells of the stage's matrix that differ from its causes, and the seconds that fitting and deciding took."""
    started = time.perf_counter()
    graph = discover_stage(Subset(TASK, STAGE, settings, 0, data))
    seconds = time.perf_counter() - started
    truth = np.array([[action in CAUSES[term] for term in graph.terms] for action in graph.actions])
    return int((graph.matrix != truth).sum()), seconds


def main() -> None:
    """Print both factors."""
    torch.set_num_threads(1)
    data = gather()
    ratios = []
    for k in range(ROUNDS):
        loop, batched = loop_rate(data, k), batched_rate(data, 2)
        ratios.append(batched / loop)
        print(f"loop {loop:8.0f}, batched {batched:8.0f} pair samples/s: {ratios[-1]:.1f}x")
    print(f"At equal samples seen: {np.median(ratios):.1f}x (goal 12x)")

    ours = Subset(TASK, STAGE, OURS, 0, data).samples()
    epochs = train_reward_models(pairs_of(ours), OURS.options, STAGE, lambda share: None).epochs
    early, early_seconds = wrong_cells(data, OURS)
    full, full_seconds = wrong_cells(data, LITERAL)
    seen, paper = 2 * OURS.training_count * (1 - HELD_OUT) * epochs, 2 * COUNT * LITERAL.options.max_epochs
    print(f"Stopping early: a pair sees {seen:,.0f} samples against {paper:,}: {paper / seen:.1f}x (goal 10x)")
    most, ours_seen = LITERAL.options.max_epochs, 2 * OURS.training_count
    print(f"  {epochs} epochs against {most}, on {ours_seen:,} samples against {2 * COUNT:,}")
    print(f"  fit and decision {early_seconds:.1f} s against {full_seconds:.1f} s: {full_seconds / early_seconds:.1f}x")
    print(f"  wrong cells of 14: {early} stopped early, {full} by the paper's optimisation")


if __name__ == "__main__":
    main()
