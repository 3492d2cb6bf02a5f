"""Mask controls: what each changes, what it keeps, and that the scripted expert can still solve it."""

import dataclasses

import numpy as np
import pytest
from scenes import counting, worlds_of

from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.truth.oracle import StageTruth, oracle_graph
from causalbench.core.kinematic import make
from causalbench.core.learners.causal_gradient import stage_plan
from causalbench.core.learners.controls import CONTROLS, control_graph
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.training_graph import training_graph
from causalbench.core.staged.restricted_expert import solved_starts
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.batch import make_batch
from causalbench.errors import InvalidGraphError

METHOD = {method.name: method for method in METHODS}
GRAPH = manual_graph(TASK)
MAKE = worlds_of(TASK, make)


@pytest.fixture(scope="module")
def worlds():
    return SceneWorlds(TASK, make_batch(make, 50))


@pytest.fixture(scope="module")
def controls(worlds) -> dict[str, CausalGraph]:
    return {name: control_graph(name, GRAPH, worlds, seed=3) for name in CONTROLS}


def _pairs(controls, name):
    """(own, control) graphs of the stages that changed."""
    changed = controls[name].provenance["changed_stages"]
    return [(a, b) for a, b in zip(GRAPH.stages, controls[name].stages, strict=True) if a.stage in changed]


def test_a_method_that_names_a_discoverer_takes_the_graphs_of_no_other():
    one, other = (
        dataclasses.replace(GRAPH, origin="discovered", provenance={"settings": {"discoverer": name}})
        for name in ("kl", "paired")
    )
    assert training_graph(TASK, METHOD["cmSAC-kl"], one, MAKE, 0) is one
    assert training_graph(TASK, METHOD["cmSAC"], other, MAKE, 0) is other
    with pytest.raises(InvalidGraphError, match=r"'cmSAC-kl' needs a graph by the discoverer 'kl', .* is by 'paired'"):
        training_graph(TASK, METHOD["cmSAC-kl"], other, MAKE, 0)


@pytest.mark.parametrize("name", list(CONTROLS))
def test_every_control_changes_a_matrix_and_leaves_every_stage_solvable(controls, worlds, name):
    graph = controls[name]
    assert (graph.origin, graph.provenance["of"]) == ("control", GRAPH.hash)
    assert graph.provenance["changed_stages"]
    graph.check(TASK)
    allowed = {control.stage: control.causal_actions() for control in graph.stages}
    for own, control in zip(GRAPH.stages, graph.stages, strict=True):
        same = own.stage not in graph.provenance["changed_stages"]
        assert (own.matrix == control.matrix).all() == same
        assert solved_starts(worlds, own.stage, allowed, 20).all()


def test_masks_at_fixed_actions(controls):
    """Stage 4 has one action and one term, so it has no other mask."""
    for name in ("shuffled", "redrawn"):
        assert controls[name].provenance["changed_stages"] == [1, 2, 3]
        for own, control in _pairs(controls, name):
            assert control.causal_actions() == own.causal_actions()
            assert control.matrix.sum() == own.matrix.sum()
    for own, control in _pairs(controls, "shuffled"):
        assert sorted(map(tuple, control.matrix)) == sorted(map(tuple, own.matrix))


@pytest.mark.parametrize(("name", "count"), [("plus1", 1), ("plus2", 2)])
def test_extra_actions_enter_with_every_term(controls, name, count):
    assert controls[name].provenance["changed_stages"] == [1, 2, 3, 4]
    for own, control in _pairs(controls, name):
        new = control.matrix.any(1) & ~own.matrix.any(1)
        assert new.sum() == count
        assert control.matrix[new].all()
        np.testing.assert_array_equal(control.matrix[~new], own.matrix[~new])


def test_other_sets_have_as_many_actions_and_only_grip_can_grasp(controls):
    assert controls["other"].provenance["changed_stages"] == [1, 2, 3]
    for own, control in _pairs(controls, "other"):
        assert len(control.causal_actions()) == len(own.causal_actions())
        assert control.causal_actions() != own.causal_actions()


def test_a_control_starts_from_the_actions_that_a_policy_sets(worlds):
    """Stage 4 with every action a cause, and grip enough."""
    *first, last = GRAPH.stages
    all_causes = dataclasses.replace(last, matrix=np.ones_like(last.matrix), sufficient=("grip",))
    control = control_graph("plus1", dataclasses.replace(GRAPH, stages=(*first, all_causes)), worlds, seed=3)
    assert len(control.stages[3].policy_actions()) == 2
    assert "grip" in control.stages[3].policy_actions()


def test_controls_are_a_function_of_the_seed(worlds):
    same, again, different = (control_graph("redrawn", GRAPH, worlds, seed) for seed in (0, 0, 1))
    assert same.hash == again.hash != different.hash


def test_a_graph_that_cannot_be_solved_has_no_control(worlds):
    stages = list(GRAPH.stages)
    without = stages[0].matrix.copy()
    without[TASK.actions.index("armz")] = False
    stages[0] = dataclasses.replace(stages[0], matrix=without)
    graph = dataclasses.replace(GRAPH, stages=tuple(stages))
    with pytest.raises(InvalidGraphError, match=r"stage 1: the scripted expert cannot solve .* armx army grip alone"):
        control_graph("shuffled", graph, worlds, 0)


def test_the_oracles_graph_has_its_strong_edges_and_declares_what_it_could_not_test():
    truth = []
    for own in GRAPH.stages:
        effect = np.where(own.matrix, 0.5, 0.0)
        low, high = effect - 0.01, effect + 0.001
        low[0, 0], high[0, 0] = 0.01, 0.2  # weak
        for array in (effect, low, high):
            array[:, -1] = np.nan
        truth.append(
            StageTruth(
                own.stage, own.actions, own.terms, effect, low, high, np.zeros(len(own.terms)), True, 400, 400 * 9
            )
        )
    graph = oracle_graph(TASK, tuple(truth), seed=0)
    assert (graph.origin, graph.env_steps) == ("oracle", 400 * 9 * 4)
    for own, stage in zip(GRAPH.stages, graph.stages, strict=True):
        np.testing.assert_array_equal(stage.matrix, own.matrix)


@pytest.mark.long
def test_the_oracle_is_asked_about_actions_held_as_long_as_those_of_the_discovery():
    make_counting, counts = counting(make)
    method, make_worlds = METHOD["cmSAC-oracle"], worlds_of(TASK, make_counting)
    one, held = (training_graph(TASK, method, None, make_worlds, 0, repeat) for repeat in (1, 2))
    assert (one.provenance["action_repeat"], held.provenance["action_repeat"]) == (1, 2)
    assert [one.env_steps, held.env_steps] == counts
    assert held.hash != one.hash


def test_a_graph_that_was_drawn_before_is_not_drawn_again():
    control = dataclasses.replace(GRAPH, origin="control")
    assert training_graph(TASK, METHOD["cmSAC-plus1"], control, MAKE, 0) is control
    assert training_graph(TASK, METHOD["cmSAC"], GRAPH, MAKE, 0) is GRAPH
    assert training_graph(TASK, METHOD["cmSAC-kl"], GRAPH, MAKE, 0) is GRAPH  # which nobody discovered
    assert training_graph(TASK, METHOD["mSAC"], None, MAKE, 0) is None


@pytest.mark.parametrize("learner", ["SAC", "PPO"])
@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_each_half_of_the_method_by_itself(learner, stage):
    both, scalar, full = (
        stage_plan(TASK, METHOD[name], GRAPH, stage)
        for name in (f"cm{learner}", f"cm{learner}-scalar", f"cm{learner}-full")
    )
    assert scalar.actions.tolist() == both.actions.tolist()
    assert scalar.mask.shape == (len(both.actions), 1)
    assert full.actions.tolist() == list(range(7))
    np.testing.assert_array_equal(
        full.mask[both.actions] @ full.reward_groups, both.mask @ both.reward_groups
    )  # the causal actions learn from the same terms
    idle = np.setdiff1d(full.actions, both.actions)
    shared = [not term.discoverable and stage in term.stages for term in TASK.terms]
    assert ((full.mask @ full.reward_groups)[idle] == shared).all()
