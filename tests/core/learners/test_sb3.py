"""The reference rows: SB3's own agents behind the same evaluation, counting and policy files."""

import dataclasses
import random
import tempfile

import numpy as np
import pytest
import torch
from training import METHOD, train

from causalbench.core.kinematic import make
from causalbench.core.learners.policy import ObservationScale, StagedPolicy, load_policy
from causalbench.core.learners.ppo import settings as ppo
from causalbench.core.learners.sac import settings as sac
from causalbench.core.learners.sb3.scalar_reward_env import ScalarRewardEnv
from causalbench.core.learners.sb3.settings import PPO_PRESETS, SAC_PRESETS, SB3PPOSettings, SB3SACSettings
from causalbench.core.learners.sb3.training import exported_actor, make_ppo, make_sac
from causalbench.core.learners.scalars import make_scalar
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.batch import make_batch

TINY = {
    "SAC": SB3SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=40, train_every=20, n_envs=2),
    "PPO": SB3PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=64, n_epochs=2, n_envs=2, target_kl=1e9),
}
LOOK = EvaluationSettings(every=100, episodes=1, final_episodes=1)


def _train(name):
    seen = []
    policy, counts = train(TASK, make, METHOD[name], None, TINY[name], LOOK, 150, 0, lambda e, c: seen.append(e))
    return policy, counts, seen


@pytest.mark.parametrize("name", ["SAC", "PPO"])
def test_they_are_counted_evaluated_and_saved_like_the_others(name, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    kept = random.getstate(), np.random.get_state()[1].copy(), torch.get_rng_state()  # noqa: NPY002
    (policy, counts, seen), (_, _, again) = _train(name), _train(name)
    assert [e.env_steps for e in seen] == [100, 150]
    assert counts.env_steps == counts.transitions.sum() == 150
    expected = {"SAC": (150 - 40) // 20 * 5, "PPO": 2 * 2 * 4}[name]  # SB3's counts from the settings above
    assert counts.updates == dict.fromkeys((1, 2, 3, 4), expected)
    assert seen == again
    assert random.getstate() == kept[0]
    np.testing.assert_array_equal(np.random.get_state()[1], kept[1])  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), kept[2])
    assert [*(tmp_path / "temporary").glob("SB3-*")] == []  # its logger makes one unless it is told not to

    policy.save(tmp_path / "policy")
    loaded = load_policy(tmp_path / "policy")
    obs, _ = StageTaskEnv(SceneWorlds(TASK, make())).reset(seed=3)
    np.testing.assert_array_equal(loaded.predict(obs)[0], policy.predict(obs)[0])


@pytest.mark.parametrize("name", ["SAC", "PPO"])
def test_the_exported_policy_is_sb3s_own(name):
    settings = dataclasses.replace(TINY[name], learning_rate=1e-2)
    env = StageTaskVectorEnv(SceneWorlds(TASK, make_batch(make, settings.n_envs)))
    scale = ObservationScale.of(env.single_observation_space, TASK)
    worlds = ScalarRewardEnv(env, scale, make_scalar("shaped", TASK, 2, 0.99), seed=0)
    model = {"SAC": make_sac, "PPO": make_ppo}[name](settings, worlds, seed=0)
    model.learn(120)
    distribution = "squashed" if name == "SAC" else "gaussian"
    policy = StagedPolicy([exported_actor(model)] * 4, [np.arange(7)] * 4, 7, scale, distribution)
    obs, _ = env.reset(seed=5)
    theirs, _ = model.predict(scale(obs).numpy(), deterministic=True)
    np.testing.assert_allclose(policy.predict(obs)[0], theirs, atol=1e-6)


def test_sb3_sees_one_reward_and_time_limits():
    env = StageTaskVectorEnv(SceneWorlds(TASK, make_batch(make, 2)))
    summed = make_scalar("paper", TASK, 2, 0.99)
    worlds = ScalarRewardEnv(env, ObservationScale.of(env.single_observation_space, TASK), summed, seed=0)
    first = worlds.reset()
    total, expected = np.zeros(2), np.zeros(2)
    step_of = env.step

    def watched(actions):
        found = step_of(actions)
        expected[:] += found[1]
        return found

    env.step = watched
    for step in range(TASK.horizon):
        obs, rewards, over, infos = worlds.step(np.full((2, 7), 0.1 * (-1) ** step))
        total += rewards
        assert over.all() == (step == TASK.horizon - 1)
    np.testing.assert_allclose(total, expected, rtol=1e-5)
    assert all(info["TimeLimit.truncated"] for info in infos)
    assert worlds.counter.counts.env_steps == 2 * TASK.horizon
    assert (infos[0]["terminal_observation"] != obs[0]).any()  # the next start is another
    assert (abs(first[:, :16]) <= 1).all()
    assert worlds.observation_space.contains(first[0])


@pytest.mark.parametrize(("ours", "theirs"), [(sac.PRESETS, SAC_PRESETS), (ppo.PRESETS, PPO_PRESETS)])
def test_a_preset_differs_from_the_staged_learners_in_nothing_that_both_have(ours, theirs):
    assert ours.keys() == theirs.keys()
    for name, preset in theirs.items():
        staged = dataclasses.asdict(ours[name])
        shared = {key: value for key, value in dataclasses.asdict(preset).items() if key != "scalar"}
        assert {key: staged[key] for key in shared} == shared
    assert theirs["quick"] == type(theirs["quick"])()  # what a suite without a preset takes
