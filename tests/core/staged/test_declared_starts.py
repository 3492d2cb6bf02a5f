"""What a task declares of its starts: several objects, starts that hold one, and numbers of the start in its facts."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest
from stacking import STACKING, height

from causalbench.conformance.moves import start
from causalbench.core.kinematic import make
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.errors import CausalbenchError, LayoutDrawError, UserError

SHAPES = pytest.mark.parametrize("n", [None, 1, 3])


@pytest.fixture(params=["native", "list"])
def worlds_of(request, monkeypatch):
    """A function (n, task) that makes kinematic worlds, as one array or as a list of scenes."""
    if request.param == "list":
        monkeypatch.setattr("causalbench.core.world.batch.Batchable", type("Nothing", (), {}))
    return lambda n=None, task=STACKING: make_scene_worlds(task, make, n)


def rngs(count, seed=0):
    return [np.random.default_rng([seed, i]) for i in range(count)]


def put(worlds, stage=None, seed=0):
    worlds.reset(range(worlds.n), rngs(worlds.n, seed), stage)
    return worlds


def layouts(worlds):
    """The starts of the worlds, from the scenes themselves."""
    return [worlds.scene.layout_of(i) for i in range(worlds.n)] if worlds.shape else [worlds.scene.layout]


def numbers(facts):
    return {name: value.tolist() for name, value in facts.extras.items()}


@SHAPES
def test_a_stage_after_the_grasp_is_entered_by_a_reset(worlds_of, n):
    worlds = put(worlds_of(n), stage=2)
    assert np.all(worlds.facts.holding)
    assert np.all(worlds.stage == 2)
    before = worlds.facts
    for _ in range(4):
        step = worlds.step(worlds.expert())
    rise = worlds.facts.object_position[..., 2] - before.object_position[..., 2]
    assert np.all(rise > 0.01)
    assert np.allclose(rise, worlds.facts.eef_position[..., 2] - before.eef_position[..., 2])
    assert np.array_equal(worlds.facts.other_positions, before.other_positions)
    assert np.all(step.rewards[..., 1] > 0)


@pytest.mark.parametrize("held_starts", [frozenset(), frozenset({1})])
def test_and_refused_in_a_sentence_where_the_task_does_not_say_so(held_starts):
    task = dataclasses.replace(STACKING, held_starts=held_starts)
    message = (
        r"task 'stacking' found no start in stage 2 on backend 'kinematic' in 200 draws: .*held_starts.* The last one: "
        rf"it holds the object in stage 2, and the task's held_starts are \[{'1' if held_starts else ''}\]"
    )
    with pytest.raises(LayoutDrawError, match=message):
        put(make_scene_worlds(task, make), stage=2)


def test_the_contract_starts_a_task_as_environments_do():
    scene = make()
    start(scene, 0, 2, STACKING)
    assert scene.facts().holding
    with pytest.raises(AssertionError, match=r"no start of stage 2 in 200 draws of stacking .*: 200 with holding"):
        start(scene, 0, 2, dataclasses.replace(STACKING, held_starts=frozenset()))


def test_a_start_in_contact_or_in_another_stage_is_named():
    stuck = dataclasses.replace(STACKING, stage=lambda facts: facts.holding * 0 + np.int64(1))
    with pytest.raises(LayoutDrawError, match="The last one: it lies in stage 1, not in stage 2"):
        put(make_scene_worlds(dataclasses.replace(stuck, held_starts=frozenset({1})), make), stage=2)


@SHAPES
def test_the_task_sees_the_numbers_of_each_start(worlds_of, n):
    worlds = put(worlds_of(n))
    tops = np.array([box.position[2] + box.half_extents[2] for box in (s.fixtures[0] for s in layouts(worlds))])
    assert len({*tops.tolist()}) == worlds.n
    seen = height(worlds.facts)
    assert np.array_equal(np.ravel(seen), [s.target.position[2] for s in layouts(worlds)] - tops)
    assert worlds.facts.extras["goal"].shape == (*worlds.shape, 3)
    assert np.array_equal(worlds.observe()["state"][..., 0], seen.astype(np.float32))
    worlds.step(np.zeros((*worlds.shape, 2)))
    assert np.array_equal(np.ravel(worlds.facts.extras["table"]), tops)
    with pytest.raises(ValueError, match="read-only"):
        worlds.facts.extras["goal"][...] = 0.0


def test_a_world_that_is_reset_alone_changes_its_own_numbers_only(worlds_of):
    worlds = worlds_of(3)
    worlds.reset([1], rngs(1))
    assert np.isnan(worlds.facts.extras["table"]).tolist() == [True, False, True]
    before = put(worlds).facts.extras["table"]
    worlds.reset([2], rngs(1, 7))
    assert (worlds.facts.extras["table"] == before).tolist() == [True, True, False]


@SHAPES
def test_a_restored_world_has_the_numbers_and_the_map_of_its_start(worlds_of, n):
    """In fresh worlds, and where other starts had been."""
    worlds = put(worlds_of(n), stage=2)
    worlds.step(worlds.expert())
    snapshots, facts = [bytes(worlds.snapshot(i)) for i in range(worlds.n)], worlds.facts
    step = worlds.step(worlds.expert())
    for others in (worlds_of(n), put(worlds_of(n), seed=5)):
        others.restore(range(worlds.n), snapshots)
        assert numbers(others.facts) == numbers(facts)
        assert [s.extras["table"] for s in layouts(others)] == np.ravel(facts.extras["table"]).tolist()
        assert np.array_equal(others.step(others.expert()).rewards, step.rewards)


def test_a_return_in_one_world_brings_its_numbers_back():
    worlds = put(make_scene_worlds(STACKING, make))
    first, snapshot = worlds.facts.extras["table"], worlds.snapshot(0)
    put(worlds, seed=1)
    assert worlds.facts.extras["table"] != first
    worlds.restore([0], [snapshot])
    worlds.step(np.zeros(2))
    assert worlds.facts.extras["table"] == first


def test_starts_with_different_names_do_not_share_a_batch():
    def draw_layout(rng, *rest):
        return dataclasses.replace(STACKING.draw_layout(rng, *rest), extras={f"number {rng.integers(10**6)}": 1.0})

    task = dataclasses.replace(STACKING, draw_layout=draw_layout, observe=lambda facts: facts.object_position)
    with pytest.raises(CausalbenchError, match="worlds of one batch have different extras, by name and shape"):
        put(make_scene_worlds(task, make, 2))


def test_a_name_that_the_scene_has_is_refused():
    def facts(of):
        return dataclasses.replace(of(), extras={"table": np.array(0.0)})

    scene = make()
    scene.facts = partial(facts, scene.facts)
    with pytest.raises(UserError, match=r"extras \['table'\]: the scene has numbers of these names"):
        put(make_scene_worlds(STACKING, lambda: scene))
