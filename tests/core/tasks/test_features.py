"""Features of the built-in tasks: every expected number was worked out by hand from the state variables."""

from __future__ import annotations

import dataclasses
import inspect
import math

import numpy as np
import pytest

from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.core.tasks.stage_task import FEATURE_BOUND
from causalbench.core.tasks.task import Task
from causalbench.registration import make_env

TASKS = [PURE, MOBILE]


def pure_state(hand: tuple[float, float, float], posture: tuple[float, float, float, float]) -> np.ndarray:
    """The box at (0.6, 0.1, 0.725) in the base frame."""
    return np.array([0.6, 0.1, 0.725, *hand, 0.875, *posture, 0, 0, 1, 0])


def turned(x: float, y: float) -> tuple[float, float, float, float]:
    """A hand from which one turn by `x` about its own x axis, or by `y` about its own y axis, leads straight down."""
    if x:  # (0, 0, 1, 0) turned back by x about x: (0, 0, 1, 0) (cos, -sin, 0, 0)
        return (0.0, 0.0, math.cos(x / 2), math.sin(x / 2))
    return (math.sin(y / 2), 0.0, math.cos(y / 2), 0.0)


@pytest.mark.parametrize(
    ("hand", "turn", "expected"),
    [
        ((0.6, 0.1, 0.875), (0.0, 0.0), (0, 0, 0, -1.38, 0, 0)),  # at the hover height, straight down
        ((0.6, 0.1, 0.737), (0.0, 0.0), (0, 0, 1.38, 0, 0, 0)),  # at the grasp height
        ((0.55, 0.12, 0.925), (0.0, 0.0), (0.5, -0.2, -0.5, -1.88, 0, 0)),
        ((0.6, 0.1, 0.875), (0.15, 0.0), (0, 0, 0, -1.38, 0.5, 0)),
        ((0.6, 0.1, 0.875), (0.0, -0.6), (0, 0, 0, -1.38, 0, -2)),
        ((0.2, 0.5, 1.3), (0.0, 1.2), (3, -3, -3, -3, 0, 3)),  # all beyond their bounds
    ],
)
def test_features_of_pure_manipulation(hand, turn, expected) -> None:
    found = PURE.features_of(pure_state(hand, turned(*turn)))
    np.testing.assert_allclose(found, expected, atol=1e-6)
    flipped = PURE.features_of(pure_state(hand, tuple(-c for c in turned(*turn))))
    np.testing.assert_allclose(flipped, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ((0.7, 0.0, 0.7, 0, 0, 0.6, 0.1, 0.75), (1, 0, 0.5, -0.5, -0.25)),
        ((2.0, math.pi / 2, 0.8, 0, 0, 0.6, 0.0, 0.6), (0, 1, -3, 5, 1)),  # 2 m to the left is beyond the bound
        ((0.5, -math.pi, 0.7, 0.3, 1, 0.4, 0.0, 0.7), (-1, 0, -4.5, 0, 0)),
    ],
)
def test_features_of_mobile_manipulation(state, expected) -> None:
    np.testing.assert_allclose(MOBILE.features_of(np.array(state)), expected, atol=1e-6)


def test_the_bearing_does_not_jump_straight_behind() -> None:
    behind = np.array([[1.0, angle, 0.7, 0, 0, 0.6, 0, 0.7] for angle in (math.pi - 1e-4, -math.pi + 1e-4)])
    left, right = MOBILE.features_of(behind)
    np.testing.assert_allclose(left, right, atol=2e-3)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_a_batch_has_the_features_of_its_members(task: Task) -> None:
    states = np.random.default_rng(0).normal(size=(7, len(task.state_names)))
    whole = task.features_of(states)
    assert whole.shape == (7, len(task.feature_names))
    assert whole.dtype == np.float32
    for state, features in zip(states, whole, strict=True):
        np.testing.assert_array_equal(task.features_of(state), features)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_an_environment_computes_them_from_the_state_that_it_shows(task: Task) -> None:
    assert list(inspect.signature(task.features).parameters) == ["state"]
    env, blind = (make_env(task.name, features=on) for on in (True, False))
    (obs, _), (bare, _) = env.reset(seed=3), blind.reset(seed=3)
    for _ in range(20):
        np.testing.assert_array_equal(obs["features"], task.features_of(obs["state"]))
        assert env.observation_space.contains(obs)
        assert obs.keys() - bare.keys() == {"features"}
        for name, value in bare.items():
            np.testing.assert_array_equal(obs[name], value)
        action = env.worlds.expert()
        obs, bare = env.step(action)[0], blind.step(action)[0]


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_no_feature_is_beyond_the_bound(task: Task) -> None:
    wild = dataclasses.replace(task, features=lambda state: 100 * task.features(state))
    found = wild.features_of(np.ones((3, len(task.state_names))))
    assert found.max() == FEATURE_BOUND or found.min() == -FEATURE_BOUND
    assert (abs(found) <= FEATURE_BOUND).all()
