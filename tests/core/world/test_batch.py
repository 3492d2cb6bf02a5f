"""Facts and scenes in batches: nothing is lost, whatever facts carry."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from causalbench.core.kinematic import make
from causalbench.core.world.batch import SceneList, make_batch, select, stack
from causalbench.core.world.facts import NO_POSITIONS, Facts
from causalbench.errors import CausalbenchError

NAMES = [field.name for field in dataclasses.fields(Facts)]


@pytest.fixture
def facts(pose):
    """A function (number of others, extras) that makes facts of which no two numbers are equal."""
    numbers = iter(np.arange(1.0, 1000.0))

    def facts(n_others=0, **extras):
        def fresh(shape):
            return np.array([next(numbers) for _ in range(int(np.prod(shape)))]).reshape(shape)

        fields = {name: fresh(np.shape(getattr(pose((0, 0, 0)), name))) for name in NAMES[:-3]}
        flags = {name: np.bool_(next(numbers) % 2) for name in NAMES if name.startswith(("holding", "collision"))}
        others = {"other_positions": fresh((n_others, 3)), "other_quaternions": fresh((n_others, 4))}
        return Facts(**fields | flags | others, extras={name: fresh(shape) for name, shape in extras.items()})

    return facts


def same(a: Facts, b: Facts) -> bool:
    """Whether all numbers are equal, to the bit, and so are their shapes and names."""
    pairs = [(getattr(a, name), getattr(b, name)) for name in NAMES[:-1]]
    pairs += [(a.extras[name], b.extras[name]) for name in a.extras]
    return a.extras.keys() == b.extras.keys() and all(
        np.shape(one) == np.shape(other) and np.array_equal(one, other, equal_nan=True) for one, other in pairs
    )


@pytest.mark.parametrize("n_others", [0, 1, 3])
@pytest.mark.parametrize("extras", [{}, {"table_height": (), "places": (2, 3)}])
def test_what_is_stacked_is_selected_again(facts, n_others, extras):
    worlds = [facts(n_others, **extras) for _ in range(4)]
    batch = stack(worlds)
    assert batch.eef_position.shape == (4, 3)
    assert {name: value.shape for name, value in batch.extras.items()} == {n: (4, *s) for n, s in extras.items()}
    assert all(same(select(batch, i), world) for i, world in enumerate(worlds))
    some = select(batch, np.array([2, 0]))
    assert same(select(some, 0), worlds[2])
    assert same(select(some, 1), worlds[0])


def test_objects_that_a_world_lacks_are_nan(facts):
    worlds = [facts(1), facts(0), facts(2)]
    batch = stack(worlds)
    assert batch.other_positions.shape == (3, 2, 3)
    assert batch.other_quaternions.shape == (3, 2, 4)
    for index, (world, number) in enumerate(zip(worlds, (1, 0, 2), strict=True)):
        found = select(batch, index)
        assert np.array_equal(found.other_positions[:number], world.other_positions)
        assert np.array_equal(found.other_quaternions[:number], world.other_quaternions)
        assert np.isnan(found.other_positions[number:]).all()


@pytest.mark.parametrize("other", [{}, {"height": (2,)}, {"width": ()}, {"height": (), "width": ()}])
def test_different_extras_in_one_batch_are_refused(facts, other):
    with pytest.raises(
        CausalbenchError, match=r"worlds of one batch have different extras, by name and shape: .*'height': \(\)"
    ):
        stack([facts(0, height=()), facts(0, **other)])


def test_facts_without_others_share_one_empty_array(pose):
    assert pose((0, 0, 0)).other_positions is NO_POSITIONS
    assert stack([pose((0, 0, 0))] * 3).other_positions is NO_POSITIONS
    assert pose((0, 0, 0)).extras == {}


def test_facts_have_no_subclasses():
    with pytest.raises(TypeError, match=r"Wider: Facts has no subclasses; put further numbers into `extras`"):
        type("Wider", (Facts,), {})


class Recorder:
    """Counts how often scenes that it makes are closed."""

    def __init__(self, batchable):
        self.closed, self.made, self.batchable = 0, 0, batchable

    def __call__(self):
        self.made += 1
        scene = make()
        closing = scene.close

        def close():
            self.closed += 1
            closing()

        scene.close = close
        return scene if self.batchable else Plain(scene)


class Plain:
    """A scene that is not `Batchable`."""

    def __init__(self, scene):
        self.spec, self.close, self.reset, self.facts = scene.spec, scene.close, scene.reset, scene.facts


def test_the_scene_that_makes_a_native_batch_is_closed():
    scenes = Recorder(batchable=True)
    batch = make_batch(scenes, 3)
    assert (batch.n, scenes.made, scenes.closed) == (3, 1, 1)


def test_a_list_of_scenes_closes_them_with_itself():
    scenes = Recorder(batchable=False)
    batch = make_batch(scenes, 3)
    assert isinstance(batch, SceneList)
    assert (batch.n, scenes.made, scenes.closed) == (3, 3, 0)
    batch.close()
    assert scenes.closed == 3
