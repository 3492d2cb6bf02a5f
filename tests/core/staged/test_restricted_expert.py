"""Complete yet non-redundant, the paper's criterion for a causal action space, on every simulator."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from causalbench.core.kinematic import make
from causalbench.core.staged.restricted_expert import STARTS, solved_starts
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks import mobile_manipulation
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.batch import SceneList, make_batch
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker

SIMULATORS = ("gymrob", "pybullet", "robosuite")
CAUSAL = {
    1: ("armx", "army", "armz", "grip"),
    2: ("armrx", "armry", "grip"),
    3: ("armz", "grip"),
    4: ("grip",),
}
"""The action spaces of the paper's Table III for pure manipulation, which discovery finds in gymrob, too."""

REDUNDANT = {(1, "grip"), (2, "grip"), (3, "grip")}
"""Causes that solving does not need: in these stages `grip` causes only the penalty for closing early, and an expert
that never closes avoids it. The paper's sets are complete; they are non-redundant but for these three."""


def without(stage: int, action: str) -> dict[int, set[str]]:
    """The causal actions of every stage, less one of `stage`."""
    return {s: set(actions) - ({action} if s == stage else set()) for s, actions in CAUSAL.items()}


EDGES = [(stage, action) for stage, actions in CAUSAL.items() for action in actions]


@pytest.fixture(scope="module")
def kinematic():
    return SceneWorlds(TASK, make_batch(make, STARTS))


@pytest.mark.parametrize("stage", CAUSAL)
def test_causal_actions_solve_the_stage(kinematic: SceneWorlds, stage: int) -> None:
    assert solved_starts(kinematic, stage, CAUSAL).all()


@pytest.mark.parametrize(("stage", "dropped"), EDGES)
def test_dropping_an_action_lowers_that_unless_it_is_redundant(
    kinematic: SceneWorlds, stage: int, dropped: str
) -> None:
    solved = solved_starts(kinematic, stage, without(stage, dropped))
    assert solved.all() == ((stage, dropped) in REDUNDANT)


def test_without_any_action_nothing_is_solved(kinematic: SceneWorlds) -> None:
    assert not any(solved_starts(kinematic, stage, {}, 10).any() for stage in CAUSAL)


def test_a_start_does_not_depend_on_the_number_of_worlds() -> None:
    """What leaves half of the starts unsolved shows that each of them is the same start."""
    one = SceneList([make()])
    several = make().batch(4)
    for batch in (several, make().batch(20)):
        np.testing.assert_array_equal(
            solved_starts(SceneWorlds(TASK, one), 2, {2: ("armry",)}, 10),
            solved_starts(SceneWorlds(TASK, batch), 2, {2: ("armry",)}, 10),
        )


MOBILE_CAUSAL = {1: ("forward", "turn"), 2: ("turn",), 3: ("armx", "army", "armz")}
"""The action spaces of the human's graph of mobile manipulation."""


@pytest.mark.parametrize("backend", ["kinematic", *(pytest.param(b, marks=pytest.mark.long) for b in SIMULATORS)])
def test_a_restricted_driver_plans_on_the_map(backend: str) -> None:
    """Straight on, without a map, 35 of the 50 starts of stage 1 are solved. Each action of a stage is needed."""
    task = mobile_manipulation.TASK
    worlds = worlds_maker(installed().backend(backend), task)(1 if backend in SIMULATORS else STARTS)
    for stage, actions in MOBILE_CAUSAL.items():
        assert solved_starts(worlds, stage, MOBILE_CAUSAL).all(), stage
        for action in actions:
            fewer = MOBILE_CAUSAL | {stage: set(actions) - {action}}
            assert not solved_starts(worlds, stage, fewer, 10).all(), (stage, action)
    worlds.close()


def test_driving_can_stand_in_for_the_arm_in_the_plane() -> None:
    """What discovery finds in stage 3 of mobile manipulation is complete; what it finds in stage 1 is not."""
    task = mobile_manipulation.TASK
    discovered = {1: ("forward",), 2: ("forward", "turn"), 3: ("forward", "turn", "armz")}

    def expert(facts, spec, layout=None):
        """As the task's; in stage 3 the base brings the hand to the target, but for the height."""
        out, error = task.expert(facts, spec, layout), facts.object_position - facts.eef_position
        cos, sin = np.cos(facts.base_pose[..., 2]), np.sin(facts.base_pose[..., 2])
        reach = np.hypot(*np.moveaxis(facts.eef_position[..., :2] - facts.base_pose[..., :2], -1, 0))
        there = task.stage(facts) == 3
        ahead, left = cos * error[..., 0] + sin * error[..., 1], cos * error[..., 1] - sin * error[..., 0]
        gain = 0.5 / spec.control_dt / np.array(spec.action_speed[:2])
        out[..., 0] = np.where(there, ahead * gain[0], out[..., 0])
        out[..., 1] = np.where(there, left / reach * gain[1], out[..., 1])
        return np.clip(out, -1.0, 1.0)

    driver = dataclasses.replace(task, expert=expert)
    worlds = SceneWorlds(driver, make_batch(partial(make, mobile=True), STARTS))
    assert solved_starts(worlds, 3, discovered).all()
    assert solved_starts(worlds, 2, discovered).all()
    assert solved_starts(worlds, 1, discovered).mean() < 0.1  # who cannot turn arrives by luck


@pytest.mark.long
@pytest.mark.parametrize("backend", SIMULATORS)
def test_causal_actions_are_complete_and_not_redundant_in_a_simulator(backend: str) -> None:
    worlds = worlds_maker(installed().backend(backend), TASK)(1)
    for stage in CAUSAL:
        assert solved_starts(worlds, stage, CAUSAL).all(), stage
    needless = {
        (stage, action) for stage, action in EDGES if solved_starts(worlds, stage, without(stage, action)).all()
    }
    worlds.close()
    assert needless == REDUNDANT
