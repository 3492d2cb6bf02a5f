"""`StageTaskVectorEnv` against single environments, natively batched and as a list of scenes."""

from __future__ import annotations

import numpy as np
import pytest

from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.staged.starts import draw_starts
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.batch import SceneList, make_batch
from causalbench.errors import InvalidActionError, UnreachableLayoutError

N = 3


@pytest.fixture
def make_vector(make_scene):
    def make(native: bool = True) -> StageTaskVectorEnv:
        batch = make_batch(make_scene, N) if native else SceneList([make_scene() for _ in range(N)])
        return StageTaskVectorEnv(SceneWorlds(TASK, batch))

    return make


def expert(env: StageTaskVectorEnv):
    return env.worlds.expert()


def test_native_batch_equals_a_list_of_scenes(make_vector):
    native, listed = make_vector(True), make_vector(False)
    rng = np.random.default_rng(0)
    for env in (native, listed):
        env.reset(seed=4)
    for step in range(60):
        # The expert finishes, so that worlds restart on their way; some noise lets them differ.
        actions = np.clip(expert(listed) + rng.normal(0, 0.1, (N, 7)) * (step % 2), -1, 1)
        a, b = native.step(actions), listed.step(actions)
        for key in ("state", "stage", "gripper"):
            np.testing.assert_allclose(a[0][key], b[0][key], atol=1e-6, err_msg=key)
        np.testing.assert_allclose(a[4]["vector_reward"], b[4]["vector_reward"], atol=1e-9)
        for key in ("stage", "next_stage", "reversal", "is_success"):
            np.testing.assert_array_equal(a[4][key], b[4][key], err_msg=key)
        np.testing.assert_array_equal(a[2], b[2])
        np.testing.assert_array_equal(a[3], b[3])


def test_pictures_of_several_worlds_are_those_of_each(make_scene):
    batches = make_batch(make_scene, 2), SceneList([make_scene() for _ in range(2)])
    native, listed = (
        StageTaskVectorEnv(SceneWorlds(TASK, batch), observe="paper").reset(seed=4)[0]["rgb"] for batch in batches
    )
    assert native.shape == (2, 48, 64, 3)
    assert np.array_equal(native, listed)
    assert not np.array_equal(native[0], native[1])


@pytest.mark.parametrize("refusing", [(0,), (1,), (0, 1)])
def test_a_world_that_refuses_its_first_starts_gets_another(make_scene, monkeypatch, refusing):
    scenes = [make_scene() for _ in range(2)]
    for index in refusing:
        refusals, accept = iter(range(2)), scenes[index].reset

        def reset(layout, refusals=refusals, accept=accept):
            if next(refusals, None) is not None:
                raise UnreachableLayoutError("as a scene says that was never reset")
            accept(layout)

        monkeypatch.setattr(scenes[index], "reset", reset)
    draw_starts(TASK, SceneList(scenes), range(2), [np.random.default_rng(i) for i in range(2)], 1)
    for scene in scenes:
        np.testing.assert_allclose(scene.facts().object_position[:2], scene.layout.target.position[:2], atol=2e-3)
        assert TASK.stage(scene.facts()) == 1


def test_worlds_equal_single_environments_until_they_end(make_vector, make_pure):
    vector, singles = make_vector(), [make_pure() for _ in range(N)]
    obs, infos = vector.reset(seed=4)
    for i, single in enumerate(singles):
        single.reset(seed=0)
        single._np_random = np.random.default_rng([4, i])
        own, info = single.reset()
        np.testing.assert_allclose(own["state"], obs["state"][i], atol=1e-6)
        assert info["stage"] == infos["stage"][i]
    running = set(range(N))
    for _ in range(TASK.horizon):
        actions = expert(vector)
        _, rewards, terminated, truncated, infos = vector.step(actions)
        for i in sorted(running):
            own, reward, own_terminated, own_truncated, info = singles[i].step(actions[i])
            assert reward == pytest.approx(rewards[i], abs=1e-6)
            assert (own_terminated, own_truncated) == (terminated[i], truncated[i])
            np.testing.assert_allclose(own["state"], infos["final_obs"]["state"][i], atol=1e-6)
            for key in ("stage", "next_stage", "reversal", "is_success"):
                assert info[key] == infos[key][i]
            if own_terminated or own_truncated:
                running.remove(i)
        if not running:
            break
    assert not running


def test_an_ended_world_restarts_within_the_step(make_vector):
    env = make_vector()
    env.reset(seed=0)
    ended = np.zeros(N, dtype=bool)
    for _ in range(TASK.horizon):
        obs, _, terminated, truncated, infos = env.step(expert(env))
        over = terminated | truncated
        np.testing.assert_array_equal(infos["final_obs"]["stage"], infos["next_stage"] - 1)
        # A world that ended is back in stage 1; the others are where they were.
        assert (obs["stage"][over] == 0).all()
        np.testing.assert_array_equal(obs["state"][~over], infos["final_obs"]["state"][~over])
        ended |= over
        if ended.all():
            break
    assert ended.all()
    assert env.observation_space.contains(obs)


def test_every_clock_is_its_worlds_own(make_vector):
    env = make_vector()
    env.reset(seed=0)
    for step in range(1, TASK.horizon + 1):
        actions = np.zeros((N, 7))
        if step < 100:
            actions[0] = expert(env)[0]  # ends early, which restarts its clock
        _, _, _, truncated, _ = env.step(actions)
        if step < TASK.horizon:
            assert not truncated.any()
    assert truncated.tolist() == [False, True, True]


def test_invalid_actions_are_refused(make_vector):
    env = make_vector()
    env.reset(seed=0)
    before = env.worlds.scene.facts().eef_position
    for actions in (np.zeros((N, 6)), np.zeros(7), np.full((N, 7), np.nan), np.full((N, 7), 1.5)):
        with pytest.raises(InvalidActionError):
            env.step(actions)
    np.testing.assert_array_equal(env.worlds.scene.facts().eef_position, before)


def test_one_seed_gives_one_trajectory(make_vector):
    first, second = make_vector(), make_vector()
    for env in (first, second):
        env.reset(seed=7)
    second.reset(seed=3)
    second.step(np.ones((N, 7)))
    second.reset(seed=7)
    for _ in range(30):
        actions = expert(first)
        np.testing.assert_array_equal(first.step(actions)[0]["state"], second.step(actions)[0]["state"])


def test_a_state_goes_on_in_another_vector_environment(make_vector):
    """Batched or not: the snapshots are the scene's."""
    first, second = make_vector(True), make_vector(False)
    first.reset(seed=7)
    for _ in range(20):
        first.step(expert(first))
    before = first.worlds.observe()
    state, clock = first.state(), first._clock.copy()
    obs = second.load_state(state)
    for key, value in before.items():
        np.testing.assert_array_equal(obs[key], value)
    for _ in range(20):
        actions = expert(first)
        a, b = first.step(actions), second.step(actions)
        np.testing.assert_allclose(a[0]["state"], b[0]["state"], atol=1e-6)
    np.testing.assert_array_equal(state["clock"], clock, err_msg="a state that was kept went on with its worlds")
    for one, other in zip(first._rngs, second._rngs, strict=True):
        assert one.random() == other.random()
