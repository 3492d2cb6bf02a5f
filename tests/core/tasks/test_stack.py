"""Stacking: its stages, what it pays, and what becomes of a box that is dropped, on poses with known answers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from causalbench.core.kinematic import make
from causalbench.core.numerics import rotations
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks import stack
from causalbench.core.tasks.stack import PLACE, TASK

BASE = np.array([0.1, 0.6, 0.72])
DOWN = rotations.multiply(rotations.from_axis_angle(2, np.pi / 2), rotations.FACE_DOWN)


def column(term: str) -> int:
    return TASK.term_names.index(term)


@pytest.fixture(scope="module")
def worlds():
    worlds = SceneWorlds(TASK, make())
    worlds.reset([0], [np.random.default_rng(0)])
    yield worlds
    worlds.close()


def facts(worlds, away, holding, opening=0.03):
    """The box `away` from its place, the hand around it."""
    box = BASE + PLACE + away
    return dataclasses.replace(
        worlds.facts,
        other_positions=BASE[None],
        object_position=box,
        eef_position=box + [0.0, 0.0, 0.012],
        eef_quaternion=DOWN,
        holding=np.bool_(holding),
        gripper_opening=np.array(opening),
    )


@pytest.mark.parametrize(
    ("away", "holding", "stage"),
    [
        ([0.1, 0.0, 0.0], True, 5),  # held, beside its place
        ([0.0, 0.0, 0.2], True, 5),  # held, far too high
        ([0.0, 0.0, 0.05], True, 6),  # held above its place
        ([0.0, 0.0, 0.05], False, 4),  # dropped there: the hand is around it, and can grasp it
        ([0.0, 0.0, 0.0], False, 6),  # in its place
        ([0.019, -0.019, 0.011], False, 6),
        ([0.021, 0.0, 0.0], False, 4),
        ([0.0, 0.0, -0.011], True, 5),  # pressed into the lower box
    ],
)
def test_a_stage_is_a_function_of_the_poses_and_of_what_is_held(worlds, away, holding, stage):
    assert int(stack.stage(facts(worlds, away, holding))) == stage


def test_a_dropped_box_falls_back_to_where_the_hand_is(worlds):
    dropped = dataclasses.replace(facts(worlds, [0.1, 0.0, -0.02], False), eef_position=BASE + [0.3, 0.0, 0.3])
    assert int(stack.stage(dropped)) == 1


@pytest.mark.parametrize(
    ("away", "holding", "opening", "done"),
    [
        ([0.0, 0.0, 0.003], False, 0.05, True),
        ([0.0, 0.0, 0.003], True, 0.05, False),
        ([0.0, 0.0, 0.003], False, 0.031, False),  # the fingers are not clear of it
        ([0.0, 0.0, 0.013], False, 0.05, False),  # it would fall
        ([0.031, 0.0, 0.003], False, 0.05, False),
    ],
)
def test_success_is_a_box_in_its_place_that_was_let_go(worlds, away, holding, opening, done):
    now = facts(worlds, away, holding, opening)
    assert bool(stack.success(np.int64(6), now)) == done
    assert not stack.success(np.int64(5), now)


def test_carrying_pays_ten_a_metre_by_axis_and_opening_on_the_way_costs(worlds):
    before, now = facts(worlds, [0.2, 0.1, 0.02], True), facts(worlds, [0.17, 0.11, 0.04], True)
    opening = np.array([0.0, 0, 0, 0, 0, 0, -0.5])
    paid = stack.rewards(before, np.int64(5), opening, now, np.int64(5))
    expected = {"r_boxx": 0.3, "r_boxy": -0.1, "r_boxz1": 0.2, "r_gripper": -0.5}
    assert {name: pytest.approx(expected.get(name, 0.0)) for name in TASK.term_names} == dict(
        zip(TASK.term_names, paid, strict=True)
    )


def test_a_grasp_and_a_release_pay_five_and_the_bonus(worlds):
    for stage, now, following in (
        (4, facts(worlds, [0.1, 0, 0], True), 5),
        (6, facts(worlds, [0, 0, 0], False, 0.05), 6),
    ):
        paid = stack.rewards(facts(worlds, [0.1, 0, 0], False), np.int64(stage), np.zeros(7), now, np.int64(following))
        assert paid[column("r_gripper")] == 5.0
        assert paid[column("r_success")] == 2.0


def test_the_boxes_of_a_start_lie_apart_and_equally_often_on_either_side(worlds):
    layouts = [TASK.draw_layout(np.random.default_rng(seed), worlds.spec.workspace, 0.1, 1) for seed in range(200)]
    ways = np.array([layout.others[0].position - layout.target.position for layout in layouts])
    assert (np.abs(ways[:, 0]) > 0.13).all()  # base y is world -x
    assert 70 < (ways[:, 0] > 0).sum() < 130


def test_what_the_expert_puts_down_stays(worlds):
    for seed in range(5):
        worlds.reset([0], [np.random.default_rng(seed)], 1)
        passed = set()
        for _ in range(TASK.horizon):
            step = worlds.step(worlds.expert())
            passed.add(int(step.next_stage))
            if step.terminated:
                break
        assert step.success, seed
        assert passed >= {2, 3, 4, 5, 6}
        assert worlds.after_success(0)


def test_a_box_that_the_hand_takes_away_again_does_not_stay():
    class Thief:
        """A scene in which the box moves on after it was let go."""

        spec = make().spec

        def __init__(self, worlds):
            self.facts_now, self.count = facts(worlds, [0.0, 0.0, 0.0], False, 0.05), 0

        def step(self, action):
            self.count += 1

        def facts(self):
            moved = self.facts_now.object_position + [0.002 * self.count, 0.0, 0.0]
            return dataclasses.replace(self.facts_now, object_position=moved)

    worlds = SceneWorlds(TASK, make())
    worlds.reset([0], [np.random.default_rng(0)])
    assert not stack.stays(Thief(worlds))
