"""robosuite's own environments in stages keep the contract of tasks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from causalbench.conformance.testing import TaskConformance
from causalbench.task import Seen
from causalbench_robosuite import approach, pick, stack_cubes, tcp

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


@pytest.mark.long
class TestStackCubes(TaskConformance):
    task = "stack_cubes"


@pytest.mark.long
class TestNutAssemblySquare(TaskConformance):
    task = "nut_assembly_square"
