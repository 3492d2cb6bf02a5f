"""Discovery with the paper's observation: frames in samples and files, and in the reward models."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import discover

from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.reward_model.fit import fit_reward_models
from causalbench.core.discovery.reward_model.settings import RewardModelSettings
from causalbench.core.discovery.samples.collect import collect
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.store.samples import SampleFolder


def quiet(share: float, text: str) -> None:
    pass


def numbered(n: int, first: int = 0, sensor: str = "lidar") -> Samples:
    frames = np.repeat(np.arange(first, first + n, dtype=np.float32)[:, None], 220, 1)
    zeros = np.zeros((n, 2), dtype=np.float32)
    return Samples(zeros, zeros, zeros[:, :1], np.arange(n, dtype=np.int32), n, 0, sensor, (frames,))


def test_joined_samples_keep_blocks_of_frames_and_find_their_rows() -> None:
    joined = numbered(5).joined(numbered(4, 5)).joined(numbered(3, 9))
    assert np.shares_memory(joined.frames[0], joined.joined(numbered(1)).frames[0])
    rows = np.array([11, 0, 4, 5, 8, 9, 0])
    np.testing.assert_array_equal(joined.frames_of(rows)[:, 0], rows)
    cut = joined.first(7)
    assert [len(block) for block in cut.frames] == [5, 2, 0]
    np.testing.assert_array_equal(cut.frames_of(np.arange(7))[:, 3], np.arange(7))
    assert numbered(5).digest() != numbered(5, 1).digest()


def test_a_frame_is_what_was_seen_before_its_step() -> None:
    """The first sample of every sequence is a start, which can be drawn again."""
    rng = np.random.default_rng(2)
    samples = collect(SceneWorlds(PURE, make().batch(1)), 1, 12, None, rng, 4, 0, lambda n: None, "rgb")
    assert samples.frames[0].shape == (12, 48 * 64 * 3)
    assert samples.frames[0].dtype == np.uint8
    env = StageTaskEnv(SceneWorlds(PURE, make()), observe="paper")
    for row in range(12):
        if row and samples.sequence[row] == samples.sequence[row - 1]:
            obs, *_ = env.step(samples.actions[row - 1])
        else:  # drawn as `collect` does, from one generator
            env.np_random = np.random.default_rng(2) if row == 0 else env.np_random
            obs, _ = env.reset(options={"stage": 1})
            env.np_random.uniform(-1.0, 1.0, (min(4, 12 - row), 7))
        np.testing.assert_allclose(obs["state"], samples.states[row, :15], atol=1e-5)
        assert np.array_equal(obs["rgb"].ravel(), samples.frames[0][row])


@pytest.mark.parametrize("task", [pytest.param(PURE, marks=pytest.mark.long), MOBILE], ids=lambda task: task.name)
def test_discovery_sees_what_the_paper_says_and_keeps_it(task, tmp_path: Path) -> None:
    settings = DiscoverySettings(
        training_count=24, n_placebos=0, observation="paper", options=KLSettings(max_epochs=1, batch_size=16)
    )

    make_scene = partial(make, mobile=task is MOBILE)
    store = SampleFolder(tmp_path / "data")
    graph = discover(task, make_scene, settings, 0, quiet, store=store)
    assert graph.provenance["settings"]["observation"] == "paper"
    with np.load(tmp_path / "data" / "stage1-random.npz", allow_pickle=False) as file:
        assert file["frames"].shape == (24, 220 if task is MOBILE else 9216)
    assert discover(task, make_scene, settings, 0, quiet, store=store).hash == graph.hash
    blind = discover(task, make_scene, dataclasses.replace(settings, observation="state"), 0, quiet)
    assert blind.provenance["data_sha256"] != graph.provenance["data_sha256"]


def test_a_reward_model_reads_its_frames() -> None:
    """The reward is the action's, with a sign that only the scan shows."""
    rng = np.random.default_rng(0)

    def samples(n: int) -> Samples:
        sign, actions = rng.choice([-1.0, 1.0], n), rng.uniform(-1, 1, (n, 1)).astype(np.float32)
        frames = np.where(sign[:, None] > 0, 8.0, 2.0) + rng.normal(0, 0.3, (n, 220))
        rewards = (sign[:, None] * actions).astype(np.float32)
        states = rng.normal(size=(n, 2)).astype(np.float32)
        return Samples(
            states, actions, rewards, np.arange(n, dtype=np.int32), n, 0, "lidar", (frames.astype(np.float32),)
        )

    data, new = samples(600), samples(200)
    settings = RewardModelSettings(max_epochs=15, batch_size=32, learning_rate=1e-3)
    target = torch.from_numpy((new.rewards[:, 0] - data.rewards.mean()) / data.rewards.std())
    errors = {}
    for name, changes in (("sees", {}), ("blind", {"sensor": "", "frames": ()})):
        known, asked = (dataclasses.replace(s, **changes) for s in (data, new))
        mean, _ = fit_reward_models([known], known, settings, 0, lambda share: None).predict(asked, 0)
        errors[name] = float((mean[0] - target).pow(2).mean())
    assert errors["sees"] < 0.1
    assert errors["blind"] > 0.9
