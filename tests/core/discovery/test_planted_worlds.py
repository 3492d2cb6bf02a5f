"""Planted worlds: their effects against brute force, their snapshots, their seeds, and five lines for a stranger."""

from functools import partial

import numpy as np
import pytest

from causalbench import worlds
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.planted import examine
from causalbench.core.discovery.planted.forms import FORMS
from causalbench.core.discovery.truth.oracle import Grade, consult_oracle

KINDS = [*worlds.KINDS]


@pytest.mark.parametrize("name", FORMS)
def test_a_form_has_mean_0_variance_1_and_the_ratio_that_it_states(name):
    rng, n = np.random.default_rng(0), 400_000
    actions, s, e = rng.uniform(-1, 1, (n, 1 + (name.endswith("product")))), rng.normal(size=n), rng.normal(size=n)
    form = FORMS[name]
    values, off = form.value(actions, s, e), actions.copy()
    off[:, 0] = 0.0
    assert values.mean() == pytest.approx(0.0, abs=0.01)
    assert values.var() == pytest.approx(1.0, rel=0.03)
    assert np.mean((values - form.value(off, s, e)) ** 2) == pytest.approx(form.ratio, rel=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_the_truth_is_what_intervening_shows(kind):
    """Structure and closed form against brute force: the same state and noise, each action at 0."""
    world = worlds.planted(kind, 3)
    for stage in range(1, len(world.stages) + 1):
        brute, causes = (
            examine._monte_carlo(world, stage, 1, n=100 if kind == "distractors_10" else 1_500),
            world.causes(stage),
        )
        assert ((brute > 0) == causes).all()
        np.testing.assert_allclose(worlds.effects(world, stage), brute, rtol=0.4, atol=1e-12)


@pytest.mark.parametrize("kind", ["graded", "local", "binary", "three_stages"])
def test_the_oracle_agrees_with_the_planted_truth(kind):
    world = worlds.planted(kind, 0)
    truth = consult_oracle(world.task, partial(worlds.make_planted_worlds, world), 150, 0, lambda share, text: None)
    for stage in truth:
        effect = worlds.effects(world, stage.stage)
        grades = np.array(stage.grades())
        assert (grades[effect == 0] == Grade.absent).all()
        assert (grades[effect > 0.3] == Grade.strong).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_world_is_a_function_of_kind_and_seed(kind):
    one, again, other = (worlds.samples(worlds.planted(kind, seed), 50) for seed in (1, 1, 2))
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a, b)
    same = kind in ("causal_moma", "null") or "null" in kind
    assert same or worlds.planted(kind, 1) != worlds.planted(kind, 2)
    assert np.isfinite(other.rewards).all()


@pytest.mark.parametrize("level", [0.0, 0.3])
def test_a_restored_step_is_the_same_to_the_bit_unless_restoring_is_noisy(level):
    world = worlds.planted(f"restore_noise_{level:g}" if level else "graded")
    one = worlds.make_planted_worlds(world)
    one.reset([0], [np.random.default_rng(0)])
    one.step(np.full(world.n_actions, 0.2))
    taken, action = one.snapshot(0), np.full(world.n_actions, -0.4)
    first = one.step(action).rewards
    one.restore([0], [taken])
    again = one.step(action).rewards
    assert (first == again).all() == (level == 0)
    assert ("exact_restore" in one.capabilities) == (level == 0)


def test_restore_noise_is_the_share_that_it_says():
    world = worlds.planted("null_restore_noise_0.3")
    one = worlds.make_planted_worlds(world)
    one.reset([0], [np.random.default_rng(0)])
    pairs = []
    for _ in range(600):
        taken, action = one.snapshot(0), np.zeros(world.n_actions)
        pairs.append((one.step(action).rewards, one.restore([0], [taken]), one.step(action).rewards)[::2])
    first, again = np.array(pairs).swapaxes(0, 1)
    shared = (first * again).mean() / first.var()
    assert shared == pytest.approx(0.7, abs=0.1)


def test_five_lines_run_a_method_of_ones_own():
    def correlate(states, actions, rewards):
        both = np.corrcoef(actions.T, rewards.T)[: actions.shape[1], actions.shape[1] :]
        return np.abs(both) > 0.1

    world = worlds.planted("dominant")
    data = worlds.samples(world, 3_000)
    found = worlds.score(world, [correlate(data.states, data.actions, data.rewards)])
    assert (found.recall, found.precision) == (1.0, 1.0)


def test_ranking_is_one_for_a_right_order_and_half_for_none():
    causes = np.array([[True, False], [False, True], [False, False]])
    assert worlds.ranking(causes, causes + 0.0) == (1.0, 1.0)
    assert worlds.ranking(causes, np.zeros(causes.shape)) == (0.5, pytest.approx(1 / 3))
    assert np.isnan(worlds.ranking(np.zeros((2, 2), dtype=bool), np.zeros((2, 2))).auroc)


def test_batches_and_single_worlds_are_the_same_worlds():
    world = worlds.planted("random_graph")
    many, rng = worlds.make_planted_worlds(world, 3), np.random.default_rng(5)
    many.reset(range(3), [np.random.default_rng(i) for i in range(3)])
    actions = rng.uniform(-1, 1, (3, world.n_actions))
    together = many.step(actions).rewards
    for i in range(3):
        one = worlds.make_planted_worlds(world)
        one.reset([0], [np.random.default_rng(i)])
        np.testing.assert_allclose(one.step(actions[i]).rewards, together[i], rtol=1e-12)


@pytest.mark.parametrize("discoverer", ["paired", "fisher_z"])
def test_a_registered_discoverer_takes_a_world_as_it_takes_any_task(discoverer):
    world = worlds.planted("three_stages")
    graph = worlds.discover(world, DISCOVERERS[discoverer].configure("quick", {"training_count": 1_000}))
    assert worlds.score(world, [stage.matrix for stage in graph.stages]).recall == 1.0
