"""Reverse is slow: measured in the facts of every backend, and the same whoever steps."""

from __future__ import annotations

import dataclasses

import backend_option
import numpy as np
import pytest

from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.tasks.mobile_manipulation import TASK
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.errors import UserError
from causalbench.registration import make_env

SPEED, STEPS = 0.6, 10  # m/s, control steps of 0.1 s


def test_a_negative_value_is_scaled_and_nothing_else() -> None:
    actions = np.array([[-1.0, -1.0, -0.5, 0.0, 1.0], [0.5, 0.5, 1.0, -1.0, -1.0], [0.0, 0.0, 0.0, 0.0, 0.0]])
    expected = actions.copy()
    expected[0, 0] = -0.2
    np.testing.assert_array_equal(TASK.executed(actions), expected)
    assert PURE.executed(actions) is actions


@pytest.mark.parametrize("share", [{"fly": 0.5}, {"forward": 0.0}, {"forward": 1.5}])
def test_a_share_that_makes_no_sense_is_refused(share: dict[str, float]) -> None:
    with pytest.raises(UserError, match="reverse_share: expected shares"):
        dataclasses.replace(TASK, reverse_share=share)


@pytest.mark.parametrize("backend", backend_option.names())
def test_reverse_is_a_fifth_of_the_speed_in_every_backend(backend: str) -> None:
    """On the way ahead and, from the same start turned to the other side, back."""
    env = make_env("mobile_manipulation", backend)
    ways = {}
    for forward in (1.0, -1.0):
        env.reset(seed=4, options={"stage": 1})
        before = env.worlds.facts.base_pose
        for _ in range(STEPS):
            env.step(np.array([forward, 0.0, 0.0, 0.0, 0.0]))
        way = env.worlds.facts.base_pose - before
        ways[forward] = way[0] * np.cos(before[2]) + way[1] * np.sin(before[2])
    env.close()
    assert ways[1.0] == pytest.approx(SPEED * 0.1 * STEPS, rel=0.15)
    assert ways[-1.0] == pytest.approx(-0.2 * SPEED * 0.1 * STEPS, rel=0.15)


def test_what_discovery_tries_is_executed_alike() -> None:
    walk = Walk(make_env("mobile_manipulation").worlds, 1, np.random.default_rng(0), 5)
    walk.visit()
    lost = [walk.reward_of(np.array([forward, 0.0, 0.0, 0.0, 0.0]))[0] for forward in (-1.0, -0.5, 0.2)]
    assert lost[1] == pytest.approx(lost[0] / 2, rel=0.05)
    assert lost[2] == pytest.approx(-lost[0], rel=0.05)
