"""The environments of gymnasium-robotics in stages keep the contract of tasks."""

from __future__ import annotations

import numpy as np
import pytest

from causalbench.conformance.testing import TaskConformance
from causalbench.task import Seen
from causalbench_gymrob import franka_kitchen


def kitchen(*lacks: float) -> Seen:
    """A kitchen whose elements lack so much, with the hand 3 cm below each handle."""
    return Seen(np.array([*[0.0] * 12, *[0.0, 0.0, 0.03] * 4, *lacks]), {})


@pytest.mark.parametrize(
    ("lacks", "stage"),
    [((0.7, 0.1, 0.1, 0.1), 1), ((0.1, 0.5, 0.7, 0.4), 2), ((0.1, 0.1, 0.7, 0.4), 3), ((0.1, 0.1, 0.1, 0.4), 4)],
)
def test_the_stage_of_a_kitchen_is_the_first_that_is_not_done_now(lacks: tuple[float, ...], stage: int) -> None:
    assert franka_kitchen.stage(kitchen(*lacks)) == stage
    assert not franka_kitchen.success(4, kitchen(*lacks))


def test_a_kitchen_succeeds_with_all_done_from_the_last_stage() -> None:
    done = kitchen(0.1, 0.1, 0.1, 0.1)
    assert franka_kitchen.success(4, done)
    assert not franka_kitchen.success(3, done)


def test_a_kitchen_pays_for_what_its_elements_gain() -> None:
    paid = franka_kitchen.rewards(kitchen(0.7, 0.5, 0.6, 0.4), 1, np.zeros(9), kitchen(0.6, 0.5, 0.8, 0.4), 1)
    np.testing.assert_allclose(paid, [0, 0, 0, 0, 1.0, 0, -2.0, 0, 0], atol=1e-9)


@pytest.mark.long
class TestFetchPickAndPlace(TaskConformance):
    task = "fetch_pick_and_place"


@pytest.mark.long
class TestFrankaKitchen(TaskConformance):
    task = "franka_kitchen"
