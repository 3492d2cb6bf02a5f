"""Any Gymnasium environment as staged worlds: what a step means, how stages are entered, what is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gym_tasks import CAR, CAR_THAT_FORGETS, LINE, Line, maker, put
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from causalbench.core.discovery.samples.collect import collect
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.gym_starts import MAX_ROLLOUTS, POOL
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.errors import InvalidActionError, LayoutDrawError, UserError


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def steps_of(worlds: Any) -> int:
    """Calls of `step` that the environments of the line counted."""
    return sum(world.env.unwrapped.steps for world in worlds.worlds)


def test_a_step_of_the_car_is_that_of_the_environment_judged_by_hand() -> None:
    worlds, car = maker(CAR)(), gym.make("MountainCarContinuous-v0")
    worlds.reset([0], [rng(3)])
    (x, v), _ = car.reset(seed=int(rng(3).integers(2**31)))
    random = rng(1)
    for _ in range(40):
        action = random.uniform(-1, 1, 2)
        stage = int(worlds.stage)
        step = worlds.step(action)
        (next_x, next_v), *_ = car.step(action[:1].astype(np.float32))
        gained = 10 * (np.sin(3 * next_x) + 600 * next_v**2 - np.sin(3 * x) - 600 * v**2)
        bonus = 2.0 * (step.next_stage > stage)
        by_hand = [gained * (stage == 1), 100 * (next_v - v) * (stage == 2), -0.1 * action[0] ** 2, bonus]
        np.testing.assert_allclose(step.rewards, by_hand, atol=1e-9)
        assert worlds.states().tolist() == [next_x, next_v]
        x, v = next_x, next_v
    assert worlds.env_steps == 40


def test_features_of_a_task_stand_beside_its_state() -> None:
    task = dataclasses.replace(CAR, features=lambda state: 10 * state[..., 1:], feature_names=("quick",))
    worlds = maker(task)(2)
    worlds.reset(range(2), [rng(0), rng(1)])
    worlds.step(np.ones((2, 2)))
    obs, states = worlds.observe(), worlds.states()
    assert worlds.observation_space["features"].shape == (1,)
    np.testing.assert_array_equal(obs["features"], np.float32(10) * obs["state"][:, 1:])
    np.testing.assert_array_equal(states, np.hstack([obs["state"], obs["features"]]))
    worlds.choose_observation(features=False)
    assert worlds.observe().keys() == worlds.observation_space.keys() == {"state", "stage"}
    assert worlds.states().shape == (2, 2)


def test_several_worlds_step_as_each_alone() -> None:
    together, alone = maker(CAR)(3), [maker(CAR)() for _ in range(3)]
    together.reset(range(3), [rng(i) for i in range(3)])
    for i, worlds in enumerate(alone):
        worlds.reset([0], [rng(i)])
    actions = rng(9).uniform(-1, 1, (20, 3, 2))
    for row in actions:
        one, all_of_them = together.step(row), [worlds.step(a) for worlds, a in zip(alone, row, strict=True)]
        for name, values in one._asdict().items():
            singles = [getattr(step, name) for step in all_of_them]
            assert values.shape == (3, *np.shape(singles[0]))
            assert values.tolist() == np.array(singles).tolist()
            assert values.dtype == np.asarray(singles[0]).dtype
    assert together.observe()["state"].shape == (3, 2)
    assert together.env_steps == 60


def test_actions_are_scaled_held_and_paid_in_sum() -> None:
    worlds = maker(LINE)()
    worlds.reset([0], [rng()])
    start = worlds.states().item()
    step = worlds.step(np.array([0.25, 0.5]), repeat=3)
    # Three times half a metre, from an observation that the environment has since changed in place.
    np.testing.assert_allclose(step.rewards, [1.5, 3.0, 0.0], atol=1e-6)
    assert worlds.states().item() == pytest.approx(start + 1.5)
    assert worlds.env_steps == steps_of(worlds) == 3
    with pytest.raises(InvalidActionError):
        worlds.step(np.array([1.5, 0.0]))
    assert steps_of(worlds) == 3


def test_terms_of_other_stages_are_0_even_where_they_are_not_finite() -> None:
    task = dataclasses.replace(LINE, rewards=lambda *seen: np.array([1.0, 2.0, np.nan]))
    worlds = maker(task)()
    worlds.reset([0], [rng()])
    assert worlds.step(np.zeros(2)).rewards.tolist() == [1.0, 2.0, 0.0]


@pytest.mark.parametrize("n", [None, 2])
def test_a_world_that_ends_by_itself_stands_still_until_it_is_reset(n: int | None) -> None:
    worlds = maker(LINE)(n)
    worlds.reset(range(worlds.n), [rng()] * worlds.n)
    left = np.broadcast_to([-1.0, 1.0], (*worlds.shape, 2))
    step = worlds.step(left)
    assert step.terminated.all()
    assert not (step.success | step.reversal).any()
    assert step.rewards[..., 1].tolist() == np.full(worlds.shape, 2.0).tolist()
    where = worlds.states().tolist()
    again = worlds.step(-left)
    assert (worlds.states().tolist(), again.rewards.any(), again.terminated.all()) == (where, False, True)
    worlds.reset(range(worlds.n), [rng()] * worlds.n)
    assert not worlds.step(-left).terminated.any()


def test_environments_know_success_from_an_end() -> None:
    env, vector = StageTaskEnv(maker(LINE)()), StageTaskVectorEnv(maker(LINE)(2))
    env.reset(seed=0)
    _, _, terminated, truncated, info = env.step(np.array([-1.0, 0.0]))
    assert (terminated, truncated, info["is_success"]) == (True, False, False)
    vector.reset(seed=0)
    obs, _, terminated, truncated, infos = vector.step(np.array([[-1.0, 0.0], [1.0, 0.0]]))
    assert terminated.tolist() == infos["terminated"].tolist() == [True, False]
    assert not (truncated | infos["is_success"]).any()
    assert infos["final_obs"]["state"][0] == -1.0  # clipped to the bounds
    assert abs(obs["state"][0]) <= 0.1  # another start
    env.reset(seed=0)
    ends = [env.step(np.array([0.8, 0.0]))[2:] for _ in range(4)]  # 1.6 a step: across 3 and 6, which is success
    assert [(terminated, info["is_success"]) for terminated, _, info in ends] == [(False, False)] * 3 + [(True, True)]


def test_discovery_begins_another_sequence_where_a_world_ends() -> None:
    samples = collect(maker(LINE)(2), 1, 60, None, rng(), 10, 0, lambda steps: None)
    ended = samples.states[:-1, 0] + 2 * samples.actions[:-1, 0] < -1
    assert ended.sum() > 5
    assert (np.abs(samples.states[np.unique(samples.sequence, return_index=True)[1], 0]) <= 0.1).all()
    assert (samples.states >= -1).all()


@pytest.mark.parametrize("depth", [0, 1])
def test_an_environments_own_clock_is_taken_off(depth: int) -> None:
    def make() -> gym.Env[Any, Any]:
        timed: gym.Env[Any, Any] = gym.wrappers.TimeLimit(Line(), 2)
        return gym.wrappers.OrderEnforcing(timed) if depth else timed

    worlds = maker(dataclasses.replace(LINE, environments={"gymnasium": make}))()
    worlds.reset([0], [rng()])
    assert not any(worlds.step(np.zeros(2)).terminated for _ in range(5))


def test_options_reach_the_environment_and_the_identity_of_its_worlds() -> None:
    plain, far = maker(LINE)(), maker(LINE, start=2.5)()
    far.reset([0], [rng()])
    assert far.states().item() > 2
    assert (plain.identity["options"], far.identity["options"]) == ({}, {"start": 2.5})
    assert plain.identity | {"options": {"start": 2.5}} == far.identity


# How stages are entered


@pytest.mark.parametrize("stage", [1, 2])
@pytest.mark.parametrize("task", [
    CAR, CAR_THAT_FORGETS, LINE, dataclasses.replace(LINE, reset_into=put),
    dataclasses.replace(LINE, expert=lambda seen: np.array([1.0, 0.0])),
], ids=["pool", "expert", "random", "reset_into", "expert on the line"])  # fmt: skip
def test_starts_lie_in_their_stage_and_depend_on_the_generator_alone(task: Any, stage: int) -> None:
    fresh, used = maker(task)(), maker(task)()
    for seed in range(5):
        used.reset([0], [rng(100 + seed)], stage)
        used.step(np.ones(2))
    for seed in range(3):
        for worlds in (used, fresh):
            worlds.reset([0], [rng(seed)], stage)
            assert worlds.stage == stage
        assert fresh.states().tolist() == used.states().tolist()
        action = rng(seed).uniform(-1, 1, 2)
        assert fresh.step(action).rewards.tolist() == used.step(action).rewards.tolist()
    assert len({maker_start(task, stage, seed) for seed in range(4)}) > 1


def maker_start(task: Any, stage: int, seed: int) -> tuple[float, ...]:
    worlds = maker(task)()
    worlds.reset([0], [rng(seed)], stage)
    return tuple(worlds.states().tolist())


def test_every_step_on_the_way_to_a_stage_counts() -> None:
    worlds = maker(LINE)(2)
    worlds.reset([0, 1], [rng(1), rng(2)], 2)
    assert worlds.env_steps == steps_of(worlds) > 0
    told = []
    collect(worlds, 2, 20, None, rng(), 5, 0, told.append)
    assert worlds.env_steps == steps_of(worlds)
    direct = maker(dataclasses.replace(LINE, reset_into=put))()
    direct.reset([0], [rng()], 2)
    assert direct.env_steps == 0


def test_starts_that_can_be_returned_to_are_made_once() -> None:
    worlds, keys = maker(CAR)(), [int(_second_draw(seed)) for seed in range(30)]
    for seed in range(30):
        before = worlds.env_steps
        worlds.reset([0], [rng(seed)], 2)
        assert (worlds.env_steps == before) == (keys[seed] in keys[:seed])
    assert len(set(keys)) < 30
    before = worlds.env_steps
    worlds.forget_starts()
    worlds.reset([0], [rng(0)], 2)
    assert worlds.env_steps > before


def _second_draw(seed: int) -> int:
    """Which start of the pool a generator draws, after the seed of the environment's own start."""
    generator = rng(seed)
    generator.integers(2**31)
    return int(generator.integers(POOL))


def test_a_stage_that_nothing_leads_to_is_named_and_its_steps_are_told() -> None:
    task = dataclasses.replace(LINE, stage=lambda seen: 1, horizon=4)
    with pytest.raises(LayoutDrawError, match=f"'line' came into stage 2 in none of {MAX_ROLLOUTS} rollouts .*expert"):
        maker(task)().reset([0], [rng()], 2)
    told: list[int] = []
    worlds = maker(task)(1)
    with pytest.raises(LayoutDrawError):
        collect(worlds, 2, 5, None, rng(), 5, 0, told.append)
    assert sum(told) == worlds.env_steps == steps_of(worlds) > 0
    missing = dataclasses.replace(LINE, reset_into=lambda env, rng, stage: put(env, np.random.default_rng(0), 1))
    wrong = 3 - int(maker_stage(missing))
    with pytest.raises(LayoutDrawError, match=rf"reset_into\(env, rng, {wrong}\) led to stage {wrong} in none"):
        maker(missing)().reset([0], [rng()], wrong)


def maker_stage(task: Any) -> int:
    env = Line()
    return task.stage(task.reset_into(env, rng(), 1))


# What an environment shows and does not


def test_a_snapshot_of_another_world_is_returned_to_exactly() -> None:
    one, other = maker(CAR)(), maker(CAR)(2)
    one.reset([0], [rng(2)])
    for _ in range(10):
        one.step(one.expert())
    kept = one.snapshot(0)
    other.restore([1], [kept])  # never reset before
    actions = rng().uniform(-1, 1, (10, 2))
    ahead = [one.step(action).rewards.tolist() for action in actions]
    other.reset([0], [rng()])
    other.restore([1], [kept])
    assert [other.step(np.array([action, action])).rewards[1].tolist() for action in actions] == ahead


@pytest.mark.parametrize("task", [CAR, LINE], ids=lambda task: task.name)
def test_checkers_of_gymnasium_and_sb3_find_nothing(task: Any) -> None:
    env = StageTaskEnv(maker(task)())
    check_env(env, skip_render_check=True)
    check_env_of_sb3(env, skip_render_check=True)


def test_pictures_are_those_of_the_environment_in_the_size_asked_for() -> None:
    worlds = maker(CAR)(2)
    worlds.reset([0, 1], [rng(0), rng(1)])
    drawn = worlds.worlds[1].env.render()
    assert np.array_equal(worlds.render(drawn.shape[1], drawn.shape[0])[1], drawn)
    small = worlds.render(30, 20)
    assert (small.shape, small.dtype) == ((2, 20, 30, 3), np.uint8)
    assert np.array_equal(small[0, 0, 0], worlds.worlds[0].env.render()[0, 0])
    worlds.close()


class Boxes(Line):
    def __init__(self, space: gym.Space[Any]) -> None:
        super().__init__()
        self.action_space = space


@pytest.mark.parametrize("space", [
    gym.spaces.Discrete(2), gym.spaces.MultiBinary(2), gym.spaces.Box(-1, 1, (3,)), gym.spaces.Box(0, 1, (2,)),
    gym.spaces.Box(-np.inf, np.inf, (2,)),
], ids=str)  # fmt: skip
def test_other_action_spaces_are_refused_with_a_sentence(space: gym.Space[Any]) -> None:
    task = dataclasses.replace(LINE, environments={"gymnasium": lambda: Boxes(space)})
    with pytest.raises(UserError, match=r"task 'line': the environment's action space is .* expected a finite Box of"):
        maker(task)()


@pytest.mark.parametrize(("ask", "purpose"), [
    (lambda worlds: worlds.snapshot(0), "taking a snapshot needs the capability 'restore'"),
    (lambda worlds: worlds.restore([0], [b""]), "returning to a snapshot needs the capability 'restore'"),
    (lambda worlds: worlds.expert(), "acting as the expert needs the capability 'expert'"),
    (lambda worlds: worlds.render(64, 48), "drawing a picture needs the capability 'rgb'"),
])  # fmt: skip
def test_what_an_environment_cannot_do_is_refused_with_a_sentence(ask: Any, purpose: str) -> None:
    with pytest.raises(UserError, match=f"^{purpose}, and gymnasium does not have it in task 'line'$"):
        ask(maker(LINE)())


@pytest.mark.parametrize(("changes", "message"), [
    ({"environments": {}}, "environments: expected"),
    ({"snapshot": lambda env: b""}, "snapshot and restore: expected both"),
    ({"exact_restore": True}, "exact_restore: expected snapshot"),
    ({"paper_sensor": "rgb"}, "paper_sensor"),
    ({"state_bounds": (np.zeros(1), np.zeros(1))}, r"state_bounds: expected low < high, each of shape \(1,\)"),
    ({"state_bounds": (np.zeros(2), np.ones(2))}, "state_bounds"),
])  # fmt: skip
def test_parts_that_do_not_fit_together_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=f"task 'line': {message}"):
        dataclasses.replace(LINE, **changes)


@pytest.mark.parametrize(("changes", "message"), [
    ({"stage": lambda seen: 3}, r"stage\(\) said 3, expected 1 to 2"),
    ({"observe": lambda seen: np.zeros(2)}, r"observe\(\) said .*, expected shape \(1,\)"),
    ({"rewards": lambda *seen: np.zeros(2)}, r"rewards\(\) said .*, expected shape \(3,\)"),
    ({"expert": lambda seen: np.zeros(3)}, r"expert\(\) said .*, expected shape \(2,\)"),
])  # fmt: skip
def test_functions_that_say_something_else_are_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=f"task 'line': {message}"):
        use(maker(dataclasses.replace(LINE, **{"expert": lambda seen: np.zeros(2)} | changes))())


def use(worlds: Any) -> None:
    worlds.reset([0], [rng()])
    worlds.observe()
    worlds.step(worlds.expert())


def test_closing_closes_every_environment() -> None:
    worlds = maker(LINE)(2)
    worlds.close()
    assert [world.env.unwrapped.closed for world in worlds.worlds] == [1, 1]
