"""Copies and pickles of environments: simulators keep state that Python does not see."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import backend_option
import gymnasium as gym
import numpy as np
import pytest

from causalbench.core.staged.env import StageTaskEnv, VectorReward
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.errors import CausalbenchError, UserError
from causalbench.registration import make_env

Make = Callable[..., StageTaskEnv]
WAYS: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}


def walked(env: Any, steps: int, seed: int) -> list[Any]:
    """What random actions bring, and a new episode after them: its start comes from the environment's generator."""
    rng, seen = np.random.default_rng(seed), []
    for _ in range(steps):
        obs, reward, *over, info = env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        seen.append([*obs.values(), reward, *over, info["vector_reward"]])
    return [*seen, list(env.reset()[0].values())]


def check_copy(env: Any, way: str, steps: int = 2) -> None:
    env.reset(seed=3)
    walked(env, steps, 0)
    env.step(np.full(env.action_space.shape, 0.5, np.float32))
    twin = WAYS[way](env)
    others = walked(twin, steps, 1)  # first, and all of it: what moves with the copy is not its own
    for mine, other in zip(walked(env, steps, 1), others, strict=True):
        for one, two in zip(mine, other, strict=True):
            np.testing.assert_array_equal(one, two)
    twin.close()
    env.step(np.zeros(env.action_space.shape, np.float32))  # lives on


@pytest.mark.parametrize("backend", backend_option.names())
@pytest.mark.parametrize("way", WAYS)
def test_a_copy_goes_on_by_itself_bit_for_bit(make_pure: Make, way: str) -> None:
    check_copy(make_pure(), way)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("backend", backend_option.driving())
def test_a_copy_of_a_robot_that_drives_does_so_too(backend: str, way: str) -> None:
    env = make_env("mobile_manipulation", backend, observe="state")
    check_copy(env, way)
    env.close()


@pytest.mark.parametrize("way", WAYS)
def test_a_copy_of_a_vector_environment_goes_on_by_itself_bit_for_bit(make_pure: Make, way: str) -> None:
    make_worlds = make_pure().make_worlds
    assert make_worlds is not None
    env = StageTaskVectorEnv(make_worlds(2))
    check_copy(env, way)
    env.close()


@pytest.mark.parametrize("way", WAYS)
def test_a_copy_of_wrapped_environments_is_of_the_same_kind(way: str) -> None:
    env = VectorReward(gym.make("causalbench/PureManipulation-v0", observe_gripper=False))
    check_copy(env, way)
    assert WAYS[way](env).observation_space == env.observation_space


@pytest.mark.parametrize("way", WAYS)
def test_an_environment_can_be_copied_before_its_first_reset(way: str) -> None:
    twin = WAYS[way](make_env())
    with pytest.raises(gym.error.ResetNeeded):
        twin.step(np.zeros(7))
    twin.reset(seed=0)


@pytest.mark.parametrize("way", WAYS)
def test_a_scene_says_that_it_is_not_copied(make_pure: Make, way: str) -> None:
    worlds = make_pure().worlds
    assert isinstance(worlds, SceneWorlds)
    with pytest.raises(CausalbenchError, match="cannot be copied or pickled: make another one"):
        WAYS[way](worlds.scene)


@pytest.mark.parametrize("way", WAYS)
def test_worlds_that_nobody_can_make_again_say_so(make_pure: Make, way: str) -> None:
    worlds = make_pure().worlds
    assert isinstance(worlds, SceneWorlds)
    with pytest.raises(UserError, match="nothing says how to make more; use make_env"):
        WAYS[way](SceneWorlds(worlds.task, worlds.scene))
