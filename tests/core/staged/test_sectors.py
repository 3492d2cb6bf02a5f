"""Sectors of the LiDAR: their arithmetic on known rays, and who sees them."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scenes import discover
from training import METHOD, train

from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.learners.policy import load_policy
from causalbench.core.learners.registry import LEARNERS
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.tasks.mobile_manipulation import TASK
from causalbench.core.world.lidar import MAX_RANGE, sectors
from causalbench.errors import UserError
from causalbench.registration import make_env
from causalbench.store.samples import SampleFolder

LOOK = EvaluationSettings(every=100, episodes=1, final_episodes=1)
METHOD_OF = {"SAC": "mSAC", "PPO": "mPPO", "SB3-SAC": "SAC", "SB3-PPO": "PPO"}


def test_known_rays() -> None:
    ranges = np.full(220, MAX_RANGE)
    ranges[5], ranges[10], ranges[11], ranges[219] = 0.6, 1.0, 0.1, 1.0
    expected = np.zeros(20)
    expected[0], expected[1], expected[19] = math.exp(-1.0), 1.0, math.exp(-2.0)
    np.testing.assert_allclose(sectors(ranges), expected, atol=1e-10)
    batch = np.stack([ranges, ranges[::-1]]).astype(np.float32)
    assert sectors(batch).dtype == np.float32
    np.testing.assert_allclose(sectors(batch), [expected, expected[::-1]], atol=1e-7)


def test_an_environment_shows_them_beside_the_scan() -> None:
    env, blind = make_env("mobile_manipulation", observe="sectors"), make_env("mobile_manipulation")
    (obs, _), (bare, _) = env.reset(seed=2), blind.reset(seed=2)
    assert obs.keys() - bare.keys() == {"sectors"}
    np.testing.assert_array_equal(obs["sectors"], sectors(obs["lidar"]))
    assert env.observation_space.contains(obs)
    assert obs["sectors"].max() > 0.01


def test_a_task_without_a_lidar_refuses_them() -> None:
    with pytest.raises(UserError, match="'pure_manipulation' observes no LiDAR, so it has no `sectors`"):
        make_env(observe="sectors")


@pytest.mark.parametrize("name", LEARNERS)
def test_the_networks_of_every_learner_read_them(name: str, tmp_path: Path) -> None:
    settings = dataclasses.replace(LEARNERS[name].settings(), net_arch=(8, 8), observation="sectors")
    policy, _ = train(TASK, partial(make, mobile=True), METHOD[METHOD_OF[name]], None, settings, LOOK, 8)
    assert {actor[0].shape[0] for actor in policy.actors} == {8 + 5 + 20}
    policy.save(tmp_path / "policy")
    obs, _ = make_env("mobile_manipulation", observe="sectors").reset(seed=0)
    loaded = load_policy(tmp_path / "policy")
    np.testing.assert_array_equal(loaded.predict(obs)[0], policy.predict(obs)[0])
    assert not np.array_equal(loaded.predict(obs | {"sectors": 1 - obs["sectors"]})[0], policy.predict(obs)[0])


def test_discovery_keeps_them_as_columns_and_changes_nothing_else(tmp_path: Path) -> None:
    settings = DiscoverySettings(training_count=24, n_placebos=0, options=KLSettings(max_epochs=1, batch_size=16))
    found = {}
    for seen in ("state", "sectors"):
        chosen, store = dataclasses.replace(settings, observation=seen), SampleFolder(tmp_path / seen)
        discover(TASK, partial(make, mobile=True), chosen, 0, lambda share, text: None, store=store)
        with np.load(store.path / "stage1-random.npz", allow_pickle=False) as file:
            found[seen] = {name: file[name] for name in ("states", "state_names", "actions", "rewards")}
    assert tuple(found["sectors"]["state_names"][-20:]) == tuple(f"sector_{k}" for k in range(20))
    np.testing.assert_array_equal(found["sectors"]["states"][:, :-20], found["state"]["states"])
    assert found["sectors"]["states"][:, -20:].std() > 0.01
    for name in ("actions", "rewards"):
        np.testing.assert_array_equal(found["sectors"][name], found["state"][name])
