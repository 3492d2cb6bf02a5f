"""robosuite's own environments in stages keep the contract of tasks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from causalbench.conformance.testing import TaskConformance
from causalbench.task import Seen
from causalbench_robosuite import approach, pick, stack_cubes, tcp, two_arm_lift

HAND = np.array([0.0, 0.0, 0.9, 0.0, 0.0, -0.05, 0.0, 0.0, 0.0, 0.08, 0.0])  # open, 5 cm above the thing


def seen(hand: dict[int, float], way: tuple[float, float, float], success: bool = False) -> Seen:
    """What shows a hand as `HAND` is, but for what is said, and a thing that has `way` to go."""
    state = HAND.copy()
    for index, value in hand.items():
        state[index] = value
    return Seen(np.array([*state, *way, 0.0, 0.1, 0.2, success]), {})


FAR, OVER, PLACED = (0.1, 0.1, 0.0), (0.0, 0.0, -0.06), (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("hand", "way", "stage"),
    [
        ({3: 0.1}, FAR, 1),  # beside the thing
        ({9: 0.04}, FAR, 1),  # above it, half closed
        ({8: 0.3}, FAR, 1),  # above it, turned off
        ({}, FAR, 2),
        ({5: 0.0}, FAR, 3),
        ({5: 0.0, 10: 1.0}, FAR, 4),
        ({5: 0.0, 10: 1.0}, OVER, 5),
        ({}, OVER, 2),  # dropped on the way down
        ({5: 0.0, 10: 1.0}, PLACED, 6),
        ({5: 0.0}, PLACED, 6),
    ],
)
def test_the_stages_of_picking_up(hand: dict[int, float], way: tuple[float, float, float], stage: int) -> None:
    assert stack_cubes.TASK.stage(seen(hand, way)) == stage


@pytest.mark.parametrize(
    ("before", "grasped", "says", "verdict"),
    [(6, 0.0, True, True), (6, 1.0, True, False), (5, 0.0, True, False), (6, 0.0, False, False)],
)
def test_success_is_robosuites_of_a_thing_let_go(before: int, grasped: float, says: bool, verdict: bool) -> None:
    assert pick.success(before, seen({10: grasped}, PLACED, says)) is verdict


def test_the_terms_pay_for_what_was_gained() -> None:
    before, now = seen({}, FAR), seen({5: -0.03, 3: 0.01}, (0.08, 0.1, 0.0))
    terms = [term.name for term in pick.TERMS]
    paid = dict(zip(terms, stack_cubes.TASK.rewards(before, 2, np.zeros(7), now, 2), strict=True))
    expected = {"r_x": -0.1, "r_z": -0.2, "r_lower": 0.2, "r_goalx": 0.2, "r_away": -0.2}
    for term, value in expected.items():
        assert paid.pop(term) == pytest.approx(value)
    assert set(paid.values()) == {0.0}


@pytest.mark.parametrize(
    ("angle", "period", "said"), [(3.2, np.pi, 3.2 - np.pi), (0.5, np.pi / 2, 0.5), (-0.4, 1.0, -0.4)]
)
def test_an_angle_is_told_as_the_nearest_turn(angle: float, period: float, said: float) -> None:
    assert tcp.nearest(angle, period) == pytest.approx(said)


def test_a_hand_that_points_down_is_level() -> None:
    turned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # down, its fingers along y
    data = SimpleNamespace(
        site_xpos=[np.array([1.0, 2.0, 3.0])], site_xmat=[turned.ravel()], qpos=np.array([0.03, -0.02]),
        get_body_xmat=lambda name: np.eye(3).ravel(),
    )  # fmt: skip
    robot = SimpleNamespace(
        sim=SimpleNamespace(data=data), eef_site_id={"right": 0}, robot_model=SimpleNamespace(root_body="base"),
        _ref_gripper_joint_pos_indexes={"right": [0, 1]},
    )  # fmt: skip
    state = approach.look(robot, np.array([1.1, 2.0, 2.9]), 0.2, True)
    np.testing.assert_allclose(state, [1, 2, 3, 0.1, 0, -0.1, 0, 0, 0.2, 0.05, 1], atol=1e-12)
    assert tcp.direction(tcp.axes(robot)) == pytest.approx(np.pi / 2)


def two(a: dict[int, float], b: dict[int, float], tilt: float = 0.0, lifted: float = 0.0) -> Seen:
    """What shows two hands as `HAND` is, but for what is said, and a pot that is lifted so much."""
    hands = [np.array([{**dict(enumerate(HAND)), **hand}[i] for i in range(len(HAND))]) for hand in (a, b)]
    return Seen(np.array([*hands[0], *hands[1], lifted, tilt, 0.2, 0.3, lifted, lifted > 0.1]), {})


AWAY, ABOVE, AT, HOLDS = {3: 0.1}, {}, {5: 0.0}, {5: 0.0, 10: 1.0}  # a hand in stage 1, 2, 3, and one that holds


@pytest.mark.parametrize("hand", [AWAY, ABOVE, AT, HOLDS])
def test_the_stage_of_two_hands_is_that_of_the_one_behind(hand: dict[int, float]) -> None:
    stages = AWAY, ABOVE, AT, HOLDS
    for u, other in enumerate(stages, 1):
        expected = min(u, stages.index(hand) + 1)
        assert two_arm_lift.TASK.stage(two(hand, other)) == two_arm_lift.TASK.stage(two(other, hand)) == expected
    assert two_arm_lift.TASK.stage(two(hand, HOLDS, lifted=0.07)) == (5 if hand is HOLDS else stages.index(hand) + 1)


@pytest.mark.parametrize(
    ("before", "tilt", "lifted", "verdict"),
    [(5, 0.0, 0.11, True), (3, 0.0, 0.11, False), (5, 0.6, 0.11, False), (5, 0.0, 0.09, False)],
)
def test_a_pot_is_lifted_level_by_hands_that_held_it(before: int, tilt: float, lifted: float, verdict: bool) -> None:
    assert two_arm_lift.success(before, two(HOLDS, HOLDS, tilt, lifted)) is verdict


def test_each_hand_earns_its_own_terms_and_the_pot_earns_for_both() -> None:
    def paid(now: Seen) -> dict[str, float]:
        gains = two_arm_lift.rewards(two(HOLDS, HOLDS), 4, np.zeros(14), now, 4)
        return {term.name: gain for term, gain in zip(two_arm_lift.TERMS, gains, strict=True) if gain}

    assert paid(two(HOLDS, {**HOLDS, 3: 0.01})) == pytest.approx({"r_b_x": -0.1})
    assert paid(two({**HOLDS, 9: 0.05}, HOLDS)) == pytest.approx({"r_a_open": -0.2, "r_a_close": 0.3})
    assert paid(two(HOLDS, HOLDS, 0.1, 0.02)) == pytest.approx({"r_height": 0.2, "r_lift": 0.14, "r_level": -0.2})


def test_a_human_gives_each_hand_its_own_actions_and_the_pot_those_of_both() -> None:
    graph = two_arm_lift.TASK.manual_graph
    for stage in (1, 2, 3):
        for term, causes in graph[stage].items():
            hand = term.split("_")[1]
            alone = approach.CAUSES[stage][term.replace(f"{hand}_", "", 1)].split()
            assert causes == {f"{hand}_{action}" for action in alone}
        assert len(graph[stage]) == 2 * len(approach.CAUSES[stage])
    assert {*graph[4].values(), *graph[5].values()} == {frozenset({"a_z", "b_z"})}


@pytest.mark.long
class TestStackCubes(TaskConformance):
    task = "stack_cubes"


@pytest.mark.long
class TestNutAssemblySquare(TaskConformance):
    task = "nut_assembly_square"


@pytest.mark.long
class TestTwoArmLift(TaskConformance):
    task = "two_arm_lift"
