"""Every learner sees a task's features beside its state, unless its settings leave them out."""

from __future__ import annotations

import dataclasses
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes import worlds_of
from training import METHOD, train

from causalbench.core.kinematic import make
from causalbench.core.learners.observations import checked_observation
from causalbench.core.learners.policy import ObservationScale, load_policy
from causalbench.core.learners.registry import LEARNERS, TrainingProblem
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.errors import UserError
from causalbench.registration import make_env

LOOK = EvaluationSettings(every=100, episodes=1, final_episodes=1)
METHOD_OF = {"SAC": "mSAC", "PPO": "mPPO", "SB3-SAC": "SAC", "SB3-PPO": "PPO"}
N_STATE = {PURE.name: 16, MOBILE.name: 8}  # the first with the gripper's opening


def nothing(*_: object) -> None:
    """Told of evaluations and progress."""


@pytest.mark.parametrize("task", [PURE, MOBILE], ids=lambda task: task.name)
@pytest.mark.parametrize("name", LEARNERS)
@pytest.mark.parametrize("on", [True, False])
def test_the_networks_of_every_learner_read_them(name: str, task, on: bool, tmp_path: Path) -> None:
    settings = dataclasses.replace(LEARNERS[name].settings(), net_arch=(8, 8), features=on)
    policy, _ = train(task, partial(make, mobile=task is MOBILE), METHOD[METHOD_OF[name]], None, settings, LOOK, 8)
    expected = task.feature_names if on else ()
    assert {actor[0].shape[0] for actor in policy.actors} == {N_STATE[task.name] + len(expected)}
    policy.save(tmp_path / "policy")
    assert json.loads((tmp_path / "policy" / "policy.json").read_text())["features"] == list(expected)
    obs, _ = make_env(task.name, features=on).reset(seed=0)
    np.testing.assert_array_equal(load_policy(tmp_path / "policy").predict(obs)[0], policy.predict(obs)[0])


@pytest.mark.parametrize("name", LEARNERS)
def test_they_stand_behind_the_scaled_state_as_they_are(name: str) -> None:
    settings = LEARNERS[name].settings()
    problem = TrainingProblem(
        PURE, worlds_of(PURE, make), METHOD[METHOD_OF[name]], None, settings, LOOK, 10, 0, nothing, nothing
    )  # fmt: skip
    env = problem.vector_env(2)
    obs, _ = env.reset(seed=1)
    inputs = ObservationScale.of(env.single_observation_space, PURE, settings.observation)(obs)
    bare = ObservationScale.of(
        problem.worlds(1).observation_space, dataclasses.replace(PURE, features=None, feature_names=())
    )
    assert torch.equal(inputs[:, :16], bare(obs))
    np.testing.assert_array_equal(inputs[:, 16:].numpy(), PURE.features_of(obs["state"]))


def test_a_policy_that_misses_them_says_so() -> None:
    env, blind = make_env(), make_env(features=False)
    scale = ObservationScale.of(env.observation_space, PURE)
    obs, _ = blind.reset(seed=0)
    with pytest.raises(
        UserError, match=r"reads \['features'\], and the observation has \['gripper', 'stage', 'state'\]"
    ):
        checked_observation(obs, scale.beside, len(scale.low), PURE.n_stages)
