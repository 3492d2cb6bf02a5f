"""What a decision may not depend on: units, offsets, signs, the order of names, and what the world remembers."""

import dataclasses

import numpy as np
import pytest

from causalbench import worlds
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.samples.transitions import varies
from causalbench.core.discovery.truth.effects import effects

NAMES = ["anytime", "paired", "permutation", "fisher_z"]
BASE = worlds.planted("dominant", 4)


def _matrix(name, world):
    settings = DISCOVERERS[name].configure("quick", {"training_count": 1_000})
    (stage,) = worlds.discover(world, settings, seed=1).stages
    return stage.matrix


def _units(world, scale, offset):
    terms = tuple(dataclasses.replace(term, scale=scale, offset=offset) for term in world.stages[0])
    return dataclasses.replace(world, stages=(terms,))


def _reordered(world, order):
    """The same world whose action k is what was action order[k]."""
    place = {old: new for new, old in enumerate(order)}

    def moved(part):
        return dataclasses.replace(part, actions=tuple(place[k] for k in part.actions))

    terms = tuple(dataclasses.replace(t, parts=tuple(map(moved, t.parts))) for t in world.stages[0])
    return dataclasses.replace(world, stages=(terms,))


@pytest.fixture(scope="module", params=NAMES)
def plain(request):
    return request.param, _matrix(request.param, BASE)


@pytest.mark.parametrize(("scale", "offset"), [(1e3, 0.0), (1e-7, 0.0), (-1.0, 0.0), (1.0, 1e3)])
def test_units_offset_and_sign_change_no_decision(plain, scale, offset):
    name, expected = plain
    np.testing.assert_array_equal(_matrix(name, _units(BASE, scale, offset)), expected)


def test_the_order_of_actions_changes_no_strong_edge(plain):
    name, _ = plain
    order = [3, 0, 4, 2, 1]
    world = _reordered(BASE, order)
    strong = worlds.effects(BASE, 1) > 0.05
    assert _matrix(name, world)[strong[order]].all()


def test_the_order_of_terms_changes_no_strong_edge(plain):
    name, _ = plain
    world = dataclasses.replace(BASE, stages=(BASE.stages[0][::-1],))
    strong = worlds.effects(BASE, 1)[:, ::-1] > 0.05
    assert _matrix(name, world)[strong].all()


@pytest.mark.parametrize(("by_step", "false"), [("sequence", True), ("step", False)])
def test_a_delayed_effect_is_no_cause_unless_an_action_is_held_at_0_for_a_whole_sequence(by_step, false):
    """The paper's D_do makes one of it: there a_k = 0 comes with a_k = 0 in the step before."""
    world = worlds.planted("delayed", 0)
    own = {"max_epochs": 12}
    settings = DISCOVERERS["kl"].configure("quick", {"training_count": 1_500, "intervene": by_step}, own)
    (stage,) = worlds.discover(world, settings).stages
    truth = world.causes(1)
    assert stage.matrix[truth].all()
    assert stage.matrix[~truth].any() == false


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("scale", "offset", "expected"),
    [(1.0, 0.0, True), (1e-9, 0.0, True), (1e-3, 1e3, True), (1e6, 0.0, True), (0.0, 7.0, False), (0.0, 0.0, False)],
)
def test_whether_a_term_varies_does_not_depend_on_its_unit(scale, offset, expected, dtype):
    values = (offset + scale * np.random.default_rng(0).normal(size=(500, 1))).astype(dtype)
    assert varies(values).tolist() == [expected]


def test_an_effect_is_as_exact_with_a_large_offset():
    rng = np.random.default_rng(0)
    taken, squares = rng.normal(size=(400, 1)), rng.exponential(0.1, (400, 2, 1))
    plain, far = (effects(taken + x, squares, np.arange(400), np.random.default_rng(1), 0.95)[0] for x in (0.0, 1e6))
    np.testing.assert_allclose(plain, far, rtol=1e-6)
