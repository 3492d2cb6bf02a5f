"""The oracle against the closed-form truth of the kinematic backend; the metrics against brute force."""

import dataclasses
import itertools
from functools import partial

import numpy as np
import pytest
from scenes import worlds_of
from truth import TRUTH

from causalbench import worlds
from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.truth.oracle import Grade, consult_oracle
from causalbench.core.discovery.truth.score import Score, score_graph, score_matrix, with_score
from causalbench.core.kinematic import make
from causalbench.core.kinematic.scenes import WorldsScene
from causalbench.core.kinematic.worlds import KinematicWorlds
from causalbench.core.tasks.pure_manipulation import TASK


@pytest.fixture(scope="module")
def truth():
    return consult_oracle(TASK, worlds_of(TASK, make), 400, 0, lambda share, text: None)


def test_oracle_finds_the_closed_form_truth_on_kinematic(truth):
    found = {
        stage.stage: {
            term: {a for a, row in zip(stage.actions, stage.grades(), strict=True) if row[j] != Grade.absent}
            for j, term in enumerate(stage.terms)
        }
        for stage in truth
    }
    assert found == TRUTH


def test_where_restoring_is_exact_the_floor_is_zero(truth):
    assert all((stage.floor == 0).all() for stage in truth)


def test_the_interval_holds_the_effect(truth):
    for stage in truth:
        assert (stage.low <= stage.effect + 1e-12).all()
        assert (stage.effect <= stage.high + 1e-12).all()


def test_effect_of_a_linear_reward_is_known():
    """r_eefy in stage 1 is 10 times the way along world y wherever the hand stays on its side: Var = E[d^2], T = 1."""
    stage = consult_oracle(TASK, worlds_of(TASK, make), 400, 1, lambda share, text: None)[0]
    effect = stage.effect[stage.actions.index("armx"), stage.terms.index("r_eefy")]
    assert effect == pytest.approx(1.0, abs=0.1)


def test_the_oracle_is_a_function_of_its_seed():
    one, again, other = (
        consult_oracle(TASK, worlds_of(TASK, make), 30, seed, lambda share, text: None) for seed in (0, 0, 1)
    )
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a.effect, b.effect)
        np.testing.assert_array_equal(a.low, b.low)
    assert any(not np.array_equal(a.effect, b.effect) for a, b in zip(one, other, strict=True))


def test_score_of_the_humans_graph_names_its_two_mistakes(truth):
    total = sum(score_graph(manual_graph(TASK), truth), Score(0, 0, 0))
    # It lacks armx on r_eefz1 and has armrz on r_ori; ten edges are right.
    assert total == Score(true_positives=10, false_positives=1, false_negatives=1)
    assert (total.precision, total.recall, total.f1, total.shd) == (10 / 11, 10 / 11, 10 / 11, 2)


@pytest.mark.parametrize("seed", range(20))
def test_metrics_have_the_properties_of_metrics(seed):
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 6)), int(rng.integers(1, 5)))
    selected, present = rng.random(shape) < 0.5, rng.random(shape) < 0.5
    grades = [[Grade.strong if p else Grade.absent for p in row] for row in present]
    score = score_matrix(selected, grades)
    assert score.shd == int((selected != present).sum())
    assert score.true_positives == int((selected & present).sum())
    for value in (score.precision, score.recall, score.f1):
        assert 0.0 <= value <= 1.0
    assert score_matrix(present, grades) == Score(int(present.sum()), 0, 0)
    assert score_matrix(present, grades).f1 == 1.0
    if score.shd:
        assert score.f1 < 1.0
    # One more right cell never lowers F1.
    for k, j in itertools.product(*map(range, shape)):
        if selected[k, j] != present[k, j]:
            better = selected.copy()
            better[k, j] = present[k, j]
            assert score_matrix(better, grades).f1 >= score.f1


@pytest.mark.parametrize("seed", range(20))
def test_shd_is_a_distance_and_f1_does_not_care_which_of_two_graphs_is_the_truth(seed):
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 6)), int(rng.integers(1, 5)))
    one, two, three = (rng.random(shape) < rng.random() for _ in range(3))

    def score(selected, present):
        return score_matrix(selected, [[Grade.strong if p else Grade.absent for p in row] for row in present])

    assert (score(one, two).shd == 0) == bool((one == two).all())
    assert score(one, two).shd == score(two, one).shd
    assert score(one, three).shd <= score(one, two).shd + score(two, three).shd
    assert score(one, two).f1 == score(two, one).f1
    assert (score(one, two).precision, score(one, two).recall) == (score(two, one).recall, score(two, one).precision)


def test_weak_edges_count_only_when_asked():
    grades = [[Grade.weak, Grade.strong, Grade.absent, Grade.untestable]]
    matrix = np.array([[False, True, True, True]])
    assert score_matrix(matrix, grades) == Score(1, 1, 0)
    assert score_matrix(matrix, grades, weak_is_present=True) == Score(1, 1, 1)
    assert score_matrix(matrix, grades, weak_is_present=False) == Score(1, 1, 0)


def test_errors_of_restoring_are_no_effects():
    """Edges that are not there are hardly ever graded strong, and effects are the planted ones."""
    for kind in ("null_restore_noise_0.3", "restore_noise_0.3"):
        world = worlds.planted(kind)
        (stage,) = consult_oracle(world.task, partial(worlds.make_planted_worlds, world), 100, 0, lambda *told: None)
        effect = worlds.effects(world, 1)
        assert (np.array(stage.grades())[effect == 0] == Grade.strong).mean() < 0.1
        assert ((stage.low <= effect) & (effect <= stage.high)).mean() > 0.85


def test_what_no_state_showed_is_absent_and_its_bound_is_that_of_the_rule_of_three(truth):
    for stage in truth:
        nothing = stage.effect == 0.0
        assert nothing.any()
        np.testing.assert_allclose(stage.high[nothing], 3 / 400)
        assert (np.array(stage.grades())[nothing] == Grade.absent).all()


class Sloppy(WorldsScene):
    """Restores to a place nearby, and says that it is not exact."""

    def __init__(self):
        super().__init__(KinematicWorlds(()))
        self.spec = dataclasses.replace(self.spec, capabilities=frozenset())
        self.noise = np.random.default_rng(0)

    def restore(self, snapshot):
        super().restore(snapshot)
        self.step(self.noise.uniform(-0.2, 0.2, len(self.spec.actions)))


def test_where_restoring_is_not_exact_the_graph_says_how_large_the_error_floor_is():
    truth = consult_oracle(TASK, worlds_of(TASK, Sloppy), 40, 0, lambda share, text: None)
    graph = with_score(manual_graph(TASK), truth)
    assert graph.oracle["exact_restore"] is False
    assert graph.oracle["env_steps"] == 4 * 40 * 16
    for stage in truth:
        for value, floor in zip(graph.oracle["floor"][str(stage.stage)].values(), stage.floor, strict=True):
            assert value == floor or (value is None and np.isnan(floor))
    # A fifth of full speed, both times: about 2 * 0.2^2 of the variance that full speed causes.
    assert 0.02 < graph.oracle["floor"]["3"]["r_eefz2"] < 0.3
    assert CausalGraph.from_json(graph.to_json()).oracle == graph.oracle
