"""Checkpoints: a run that was stopped anywhere and repeated ends with the bits of one that was not."""

from __future__ import annotations

import dataclasses
import random

import numpy as np
import pytest
import torch

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.checkpoint import Checkpoints
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.records import Evaluation
from causalbench.core.learners.settings import EvaluationSettings, PPOSettings, SACSettings
from causalbench.core.learners.training import train
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins import installed

METHOD = {method.name: method for method in METHODS}
SETTINGS = SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=16, train_every=4, n_envs=2)
SMALL_PPO = PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=80, n_epochs=2, n_envs=2)
LOOKS = EvaluationSettings(every=100, episodes=1, final_episodes=1)
STEPS = 300


def _stage(facts):
    """Stripes of the gripper's opening, which actions of every stage move: each agent learns within a few steps."""
    return (np.floor(facts.gripper_opening / 0.012) % 4 + 1).astype(np.int64)


STRIPES = dataclasses.replace(TASK, horizon=20, stage=_stage)


class Kill(Exception):  # noqa: N818 - it stands for a SIGKILL
    """Ends training at a step, where a kill might."""


@dataclasses.dataclass
class Outcome:
    """Everything that training leaves behind."""

    weights: bytes
    counts: str
    updates: dict[int, int]
    evaluations: list[Evaluation]


def run(backend, name, path=None, every=30, kill_at=None, settings=None, seed=0):
    """Train on the stripes, with a `Kill` after `kill_at` steps of this call."""
    seen, steps = [], 0

    def on_progress(share, text):
        nonlocal steps
        steps += 1
        if steps == kill_at:
            raise Kill

    policy, counts = train(
        STRIPES,
        installed().backend(backend).make,
        METHOD[name],
        manual_graph(STRIPES),
        settings or {"SAC": SETTINGS, "PPO": SMALL_PPO}[METHOD[name].learner],
        LOOKS,
        STEPS,
        seed,
        lambda evaluation, counts: seen.append(evaluation),
        on_progress,
        path and Checkpoints(path, every),
    )
    weights = torch.cat([w.detach().flatten() for actor in policy.actors for w in actor])
    return Outcome(weights.numpy().tobytes(), str(dataclasses.asdict(counts)), counts.updates, seen)


@pytest.mark.parametrize(
    ("backend", "name"),
    [
        ("kinematic", "cmmSAC"),
        ("kinematic", "cSAC"),
        ("kinematic", "cmmPPO"),
        ("gymrob", "cSAC"),
        ("pybullet", "cmmSAC"),
    ],
)
def test_stopped_anywhere_and_repeated_gives_the_same_bits(backend, name, tmp_path):
    """Checkpoints fall in mid-episode, kills before, between and right after them; every stage has trained."""
    whole = run(backend, name)
    assert all(whole.updates.values())
    path = tmp_path / "checkpoint.safetensors"
    rng = random.Random(f"{backend} {name}")
    for kill_at in [rng.randint(1, 60) for _ in range(4)]:
        with pytest.raises(Kill):
            run(backend, name, path, kill_at=kill_at)
    assert run(backend, name, path) == whole
