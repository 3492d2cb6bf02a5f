"""`StageTaskEnv` on every backend: Gymnasium's, SB3's and MO-Gymnasium's own tools, and what the class promises."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import subprocess
import sys

import backend_option
import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check

from causalbench.core.kinematic import make
from causalbench.core.staged.env import StageTaskEnv, VectorReward
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import CausalbenchError, InvalidActionError, UserError

STILL = np.zeros(7, dtype=np.float32)


@pytest.fixture
def env(make_pure):
    return make_pure()


def play(env, n_steps, expert=True):
    """(obs, reward, terminated, truncated, info) of each step of an episode by the scripted expert."""
    out = []
    for _ in range(n_steps):
        action = env.worlds.expert() if expert else STILL
        out.append(env.step(action))
        if out[-1][2] or out[-1][3]:
            break
    return out


# --- other people's tools


def test_gymnasium_checker(env):
    with pytest.warns(UserWarning, match=r"not able to test alternative render modes|spec"):
        gymnasium_check(env)


def test_stable_baselines3_checker(env):
    from stable_baselines3.common.env_checker import check_env

    check_env(env)


def test_a_stock_sac_trains(env):
    from stable_baselines3 import SAC

    model = SAC(
        "MultiInputPolicy", env, learning_starts=100, batch_size=64, policy_kwargs={"net_arch": [32, 32]}, seed=0
    )
    model.learn(300)
    assert model.num_timesteps == 300
    action, _ = model.predict(env.reset(seed=1)[0], deterministic=True)
    env.step(action)


def test_mo_gymnasium_linear_reward(env):
    from mo_gymnasium.wrappers import LinearReward

    weight = np.zeros(9)
    weight[TASK.term_names.index("r_eefz1")] = 2.0
    wrapped = LinearReward(VectorReward(env), weight)
    wrapped.reset(seed=0)
    down = STILL.copy()
    down[2] = -1.0
    _, reward, _, _, info = wrapped.step(down)
    assert env.reward_space.contains(np.asarray(info["vector_reward"], dtype=np.float64))
    # The hand starts above the hover height and approaches it by some 20 mm, at 10 per metre.
    assert 0.1 < reward < 0.5
    assert reward == pytest.approx(2.0 * info["vector_reward"][2])


def test_vector_reward_returns_the_vector(make_pure):
    plain, vector = make_pure(), VectorReward(make_pure())
    plain.reset(seed=0)
    vector.reset(seed=0)
    for _ in range(5):
        action = plain.worlds.expert()
        _, scalar, *_, info = plain.step(action)
        _, reward, *_ = vector.step(action)
        assert reward.shape == vector.unwrapped.reward_space.shape == (9,)
        assert reward.dtype == np.float32
        np.testing.assert_allclose(reward, info["vector_reward"], rtol=1e-6)
        assert scalar == pytest.approx(float(info["vector_reward"].sum()))


# --- what step and reset return


def test_names_and_spaces(env):
    assert env.action_names == ("armx", "army", "armz", "armrx", "armry", "armrz", "grip")
    assert env.reward_names == (
        *("r_eefx", "r_eefy", "r_eefz1", "r_ori", "r_eefz2", "r_gripper"),
        *("r_collision_arm", "r_collision_self", "r_success"),
    )
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (7,), np.float32)
    assert set(env.observation_space.spaces) == {"state", "features", "stage", "gripper"}
    assert env.observation_space["state"].shape == (15,)
    assert env.observation_space["features"].shape == (6,)
    assert env.observation_space["stage"] == gym.spaces.Discrete(4)


def test_gripper_and_features_can_be_left_out_of_the_observation(make_pure):
    env = make_pure(observe_gripper=False, features=False)
    obs, _ = env.reset(seed=0)
    assert set(obs) == {"state", "stage"}
    assert env.observation_space.contains(obs)


@pytest.mark.filterwarnings("ignore:.*alternative render modes|.*spec")
def test_the_papers_observation_passes_other_peoples_checkers(make_pure):
    from stable_baselines3.common.env_checker import check_env

    env = make_pure(observe="paper", observe_gripper=False, features=False)
    assert env.observation_space["rgb"] == gym.spaces.Box(0, 255, (48, 64, 3), np.uint8)
    assert set(env.observation_space.spaces) == {"state", "stage", "rgb"}
    check_env(env)
    gymnasium_check(env)
    obs, _ = env.reset(seed=0)
    first = obs["rgb"].copy()
    assert np.array_equal(first, env.worlds.scene.render(64, 48))
    for _ in range(5):
        obs, *_ = env.step(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    assert not np.array_equal(first, obs["rgb"])


def test_a_scene_without_pictures_is_refused_the_papers_observation():
    scene = make()
    scene.spec = dataclasses.replace(scene.spec, capabilities=scene.spec.capabilities - {"rgb"})
    with pytest.raises(UserError, match="no capability 'rgb'"):
        StageTaskEnv(SceneWorlds(TASK, scene), observe="paper")


@pytest.mark.parametrize("backend", backend_option.names())
def test_info_and_observation_of_an_episode(env):
    obs, info = env.reset(seed=0)
    assert info == {"stage": 1}
    assert obs["stage"] == 0
    stage, seen = 1, set()
    for obs, reward, terminated, truncated, info in play(env, TASK.horizon):
        assert set(info) == {"vector_reward", "stage", "next_stage", "reversal", "is_success"}
        assert info["stage"] == stage
        stage = info["next_stage"]
        assert obs["stage"] == stage - 1
        assert env.observation_space.contains(obs)
        assert isinstance(reward, float)
        assert reward == pytest.approx(float(info["vector_reward"].sum()))
        assert type(terminated) is type(truncated) is type(info["is_success"]) is type(info["reversal"]) is bool
        assert info["reversal"] == (info["next_stage"] < info["stage"] and not info["is_success"])
        active = set(TASK.stage_terms(info["stage"]))
        assert {n for n, r in zip(env.reward_names, info["vector_reward"], strict=True) if r != 0} <= active
        seen.add(info["stage"])
    assert seen == {1, 2, 3, 4}
    # The expert ends the episode by success, which no clock had to do.
    assert (terminated, truncated, info["is_success"]) == (True, False, True)


def test_the_clock_truncates(env):
    env.reset(seed=0)
    steps = play(env, 2 * TASK.horizon, expert=False)
    assert len(steps) == TASK.horizon == 200
    assert [step[3] for step in steps] == [False] * 199 + [True]
    assert not any(step[2] for step in steps)
    env.reset(seed=0)
    assert not env.step(STILL)[3]


def test_a_success_on_the_last_step_terminates_and_does_not_truncate(env):
    env.reset(seed=0)
    needed = len(play(env, TASK.horizon))
    env.reset(seed=0)
    env._clock = TASK.horizon - needed
    _, _, terminated, truncated, _ = play(env, TASK.horizon)[-1]
    assert env._clock == TASK.horizon
    assert (terminated, truncated) == (True, False)


@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_reset_into_a_stage(env, stage):
    for seed in range(5):
        obs, info = env.reset(seed=seed, options={"stage": stage})
        assert info["stage"] == TASK.stage(env.worlds.facts) == obs["stage"] + 1 == stage
        facts = env.worlds.facts
        flags = (facts.collision_base, facts.collision_arm, facts.collision_self, facts.holding)
        assert not any(flags)
        assert env.observation_space.contains(obs)


@pytest.mark.parametrize(
    "action",
    [
        np.full(7, np.nan),
        np.array([0, 0, 0, 0, 0, 0, np.inf]),
        np.array([0, 0, 1.01, 0, 0, 0, 0]),
        np.array([0, 0, 0, 0, 0, 0, -1.01]),
        np.zeros(6),
        np.zeros(8),
        np.zeros((1, 7)),
        np.float64(0.0),
    ],
    ids=["nan", "inf", "above", "below", "short", "long", "batched", "scalar"],
)
def test_invalid_actions_are_refused_and_change_nothing(env, action):
    env.reset(seed=0)
    before = env.worlds.facts
    with pytest.raises(InvalidActionError, match="action"):
        env.step(action)
    assert issubclass(InvalidActionError, CausalbenchError)
    assert env.worlds.facts is before
    np.testing.assert_array_equal(env.worlds.scene.facts().eef_position, before.eef_position)


def test_a_scene_refuses_invalid_actions(make_scene):
    scene = make_scene()
    spec, n = scene.spec, len(scene.spec.actions)
    scene.reset(TASK.draw_layout(np.random.default_rng(0), spec.workspace, spec.max_opening, 4))
    for action in (np.full(n, np.nan), np.full(n, 2.0), np.zeros(1)):
        with pytest.raises(InvalidActionError):
            scene.step(action)


def test_step_before_reset(env):
    with pytest.raises(gym.error.ResetNeeded):
        env.step(STILL)


def test_close_twice(env):
    env.reset(seed=0)
    env.close()
    env.close()


def test_returned_arrays_are_the_callers_own(env):
    obs, _ = env.reset(seed=0)
    kept = obs["state"].copy()
    facts, position = env.worlds.facts, env.worlds.facts.eef_position.copy()
    action = env.worlds.expert()
    given = action.copy()
    env.step(action)
    np.testing.assert_array_equal(obs["state"], kept)
    np.testing.assert_array_equal(facts.eef_position, position)
    np.testing.assert_array_equal(action, given)


# --- seeds


def digest(env, seed: int) -> str:
    """Hash of all that a random episode of 20 steps and the reset after it return."""
    rng, out = np.random.default_rng(seed), hashlib.sha256()
    obs, _ = env.reset(seed=seed)
    for _ in range(20):
        out.update(obs["state"].tobytes() + obs["gripper"].tobytes())
        obs, _, _, _, info = env.step(rng.uniform(-1, 1, 7).astype(np.float32))
        out.update(info["vector_reward"].tobytes())
    out.update(env.reset()[0]["state"].tobytes())
    return out.hexdigest()


def test_one_seed_gives_one_trajectory(make_pure):
    first, second = make_pure(), make_pure()
    expected = digest(first, 5)
    assert digest(second, 5) == expected
    assert digest(first, 5) == expected  # whatever happened in this scene before
    assert digest(first, 6) != expected


@pytest.mark.parametrize("backend", backend_option.names())
def test_one_seed_gives_one_trajectory_in_a_new_process(make_pure, backend):
    script = "\n".join(
        [
            "import hashlib",
            "import numpy as np",
            "from causalbench.registration import make_env",
            inspect.getsource(digest),
            f"print(digest(make_env('pure_manipulation', {backend!r}), 5))",
        ]
    )
    command = [sys.executable, "-c", script]
    there = subprocess.run(command, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    assert there.stdout.split()[-1] == digest(make_pure(), 5)


def test_the_global_random_state_is_left_alone(make_pure):
    np.random.seed(0)  # noqa: NPY002
    before = np.random.get_state()  # noqa: NPY002
    first = digest(make_pure(), 5)
    after = np.random.get_state()  # noqa: NPY002
    assert before[0] == after[0]
    np.testing.assert_array_equal(before[1], after[1])
    assert before[2:] == after[2:]
    np.random.seed(1)  # noqa: NPY002
    assert digest(make_pure(), 5) == first
