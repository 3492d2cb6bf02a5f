"""What is asked of `reset`, of `make_env` and of `step` is honoured or refused by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gym_tasks import LINE

from causalbench.core.staged.env import StageTaskEnv, VectorReward
from causalbench.core.staged.gym_worlds import make_gym_worlds
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.errors import InvalidActionError, UserError
from causalbench.registration import make_env

ID = "causalbench:causalbench/PureManipulation-v0"


@pytest.fixture(scope="module")
def env() -> Iterator[StageTaskEnv]:
    env = make_env(backend="kinematic")
    yield env
    env.close()


@pytest.fixture
def three(env: StageTaskEnv) -> Iterator[StageTaskVectorEnv]:
    assert env.make_worlds is not None
    three = StageTaskVectorEnv(env.make_worlds(3))
    yield three
    three.close()


@pytest.mark.parametrize("seed", [0, np.int64(7), np.uint8(7), 2**32, 2**70])
def test_whole_numbers_from_0_are_seeds(seed: Any, env: StageTaskEnv, three: StageTaskVectorEnv) -> None:
    first = env.reset(seed=seed)[0]["state"].tolist()
    assert env.reset(seed=int(seed))[0]["state"].tolist() == first
    assert env.reset(seed=int(seed) + 1)[0]["state"].tolist() != first
    batch = three.reset(seed=seed)[0]["state"].tolist()
    assert three.reset(seed=int(seed))[0]["state"].tolist() == batch


@pytest.mark.parametrize("seed", [-1, True, np.bool_(True), 1.0, np.float64(1), "1", {}])
def test_all_else_is_no_seed(seed: Any, env: StageTaskEnv, three: StageTaskVectorEnv) -> None:
    for one in (env, three):
        with pytest.raises(UserError, match="expected a whole number from 0, or None"):
            one.reset(seed=seed)


def test_none_goes_on_with_the_generator(env: StageTaskEnv) -> None:
    env.reset(seed=1)
    second = env.reset(seed=None)[0]["state"].tolist()
    env.reset(seed=1)
    assert env.reset()[0]["state"].tolist() == second


def test_a_list_of_seeds_is_that_of_single_environments(env: StageTaskEnv, three: StageTaskVectorEnv) -> None:
    batch, _ = three.reset(seed=[4, 5, 6])
    assert batch["state"].tolist() == [env.reset(seed=seed)[0]["state"].tolist() for seed in (4, 5, 6)]
    three.reset(seed=[4, 5, 6])
    after = three.reset(seed=[None, 5, None])[0]["state"]
    assert (after == batch["state"]).all(1).tolist() == [False, True, False]
    for seeds in ([1, 2], [1, 2, -3], [1, 2, "3"]):
        with pytest.raises(UserError, match=r"^seed"):
            three.reset(seed=seeds)


@pytest.mark.parametrize("stage", [1, 2, np.int64(3), 4])
def test_a_stage_is_honoured(stage: Any, env: StageTaskEnv, three: StageTaskVectorEnv) -> None:
    assert env.reset(seed=0, options={"stage": stage})[1] == {"stage": stage}
    assert three.reset(seed=0, options={"stage": stage})[1]["stage"].tolist() == [stage] * 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stage": 0}, "stage 0 is not one of 1 to 4"),
        ({"stage": True}, "stage True is not one of"),
        ({"stage": 1.0}, r"stage 1\.0 is not one of"),
        ({"stage": "1"}, "stage '1' is not one of"),
        ({"stagee": 1}, "unknown key 'stagee'; known: stage"),
        ("stage", "expected a mapping, got str"),
        ([], "expected a mapping, got list"),
    ],
)
def test_other_options_are_refused(options: Any, message: str, env: StageTaskEnv, three: StageTaskVectorEnv) -> None:
    for one in (env, three):
        with pytest.raises(UserError, match=f"^options: {message}"):
            one.reset(seed=0, options=options)


def test_a_mask_resets_its_worlds_alone(three: StageTaskVectorEnv) -> None:
    with pytest.raises(UserError, match="every world must be reset before some of them are"):
        three.reset(seed=0, options={"reset_mask": np.array([True, False, True])})
    three.reset(seed=0)
    before = three.step(np.full((3, 7), 0.3))[0]["state"]
    after, info = three.reset(seed=1, options={"reset_mask": np.array([True, False, True]), "stage": 2})
    assert (after["state"] == before).all(1).tolist() == [False, True, False]
    assert info["stage"].tolist() == [2, 1, 2]
    for mask in ([True, False, True], np.array([True]), np.zeros(3, bool), np.array([1, 0, 1])):
        with pytest.raises(UserError, match="reset_mask: expected a bool array"):
            three.reset(options={"reset_mask": mask})


def test_a_step_before_the_first_reset_is_refused(three: StageTaskVectorEnv) -> None:
    with pytest.raises(gym.error.ResetNeeded):
        three.step(np.zeros((3, 7)))


@pytest.mark.parametrize("action", ["abc", None, [object()] * 7, np.zeros(7, complex), [[0], [0, 1]], {}, np.zeros(6)])
def test_what_is_no_action_is_refused_and_moves_nothing(action: Any, env: StageTaskEnv) -> None:
    env.reset(seed=0)
    before = env.worlds.observe()["state"].tolist()
    with pytest.raises(InvalidActionError):
        env.step(action)
    assert env.worlds.observe()["state"].tolist() == before


def test_the_end_of_an_episode_is_told_as_gymnasium_tells_it(three: StageTaskVectorEnv) -> None:
    three.reset(seed=0)
    *_, infos = three.step(np.zeros((3, 7)))
    assert not {"final_info", "_final_info", "_final_obs"} & set(infos)
    three._clock[:] = [three.task.horizon - 1, 0, 0]
    *_, truncated, infos = three.step(np.zeros((3, 7)))
    assert truncated.tolist() == infos["_final_obs"].tolist() == infos["_final_info"].tolist() == [True, False, False]
    assert infos["final_info"]["_is_success"].tolist() == [True, False, False]
    assert infos["final_info"]["stage"] is infos["stage"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"render_mode": "rgb_aray"}, "render_mode 'rgb_aray': expected None or 'rgb_array'"),
        ({"observe": "sttate"}, "unknown observation 'sttate'. Did you mean 'state'"),
        ({"features": "no"}, "features 'no': expected True or False"),
        ({"observe_gripper": 1}, "observe_gripper 1: expected True or False"),
        ({"task": None}, "unknown task None"),
        ({"backend": ""}, "unknown backend ''"),
        ({"backend": 3}, "unknown backend 3"),
        ({"backend": "kinematic", "mobil": True}, "got an unexpected keyword argument 'mobil'; it takes mobile=False"),
        ({"backend": "kinematic", "mobile": "yes"}, "mobile='yes' is no boolean; it takes mobile=False"),
    ],
)
def test_arguments_of_make_env_are_honoured_or_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        make_env(**arguments)


def test_pictures_of_worlds_without_any_are_refused_at_once() -> None:
    with pytest.raises(UserError, match="rgb"):
        StageTaskEnv(make_gym_worlds(LINE, "gymnasium", {}), "rgb_array")


@pytest.mark.parametrize("n", [0, -1, 1.5, True, "2"])
def test_a_number_of_worlds_is_a_whole_number_from_1(n: Any, env: StageTaskEnv) -> None:
    assert env.make_worlds is not None
    with pytest.raises(UserError, match="worlds: expected a whole number from 1"):
        env.make_worlds(n)
    with pytest.raises(UserError, match="worlds: expected a whole number from 1"):
        make_gym_worlds(LINE, "gymnasium", {}, n)


@pytest.mark.parametrize(("limit", "length"), [(5, 5), (200, 200), (-1, 200), (None, 200)])
def test_a_time_limit_shortens_an_episode(limit: int | None, length: int) -> None:
    env = gym.make(ID, backend="kinematic", max_episode_steps=limit)
    env.reset(seed=0)
    steps = 1
    while not env.step(np.zeros(7, np.float32))[3]:
        steps += 1
    assert steps == length


@pytest.mark.parametrize(
    "make",
    [
        lambda limit: gym.make(ID, backend="kinematic", max_episode_steps=limit),
        lambda limit: gym.make_vec(ID, 2, "sync", backend="kinematic", max_episode_steps=limit),
        lambda limit: gym.make(
            dataclasses.replace(gym.spec(ID.partition(":")[2]), max_episode_steps=limit), backend="kinematic"
        ),
    ],
)
def test_a_time_limit_above_the_horizon_is_refused(make: Callable[[int], Any]) -> None:
    make(200).close()
    with pytest.raises(UserError, match=r"max_episode_steps=201: an episode of .* ends after 200 control steps"):
        make(201)


def test_gymnasium_adds_its_own_render_mode() -> None:
    env = gym.make(ID, backend="kinematic", render_mode="rgb_array_list")
    assert env.render_mode == "rgb_array_list"
    assert env.unwrapped.render_mode == "rgb_array"


def test_a_wrapper_for_vector_rewards_is_made_again_by_its_spec() -> None:
    env = VectorReward(gym.make(ID, backend="kinematic"))
    again = gym.make(env.spec)
    assert isinstance(again, VectorReward)
    assert env.reward_space == again.reward_space
    assert env.reward_space.contains(again.reset(seed=0) and again.step(np.zeros(7, np.float32))[1])
