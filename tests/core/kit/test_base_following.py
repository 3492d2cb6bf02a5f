"""The lines of the contract that are about driving, in every backend that drives; the others are `long`."""

from __future__ import annotations

from collections.abc import Iterator

import backend_option
import numpy as np
import pytest

from causalbench.conformance.bench import Bench
from causalbench.conformance.check import FAIL, GAP, NOT_APPLICABLE, run_check
from causalbench.conformance.suite import CHECKS
from causalbench.core.kit import base_following as driving
from causalbench.plugins.manager import installed


@pytest.fixture(scope="module", params=backend_option.driving())
def mobile_bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = Bench(installed().backend(request.param), {"mobile": True})
    yield bench
    bench.close()


@pytest.mark.parametrize(
    "check",
    [
        pytest.param(check, id=check.number, marks=() if "mobile_base" in check.needs else pytest.mark.long)
        for check in CHECKS
    ],
)
def test_a_scene_that_drives_keeps_the_contract(mobile_bench, check):
    result = run_check(check, mobile_bench)
    assert result.outcome != FAIL, result.message
    if "mobile_base" in check.needs:
        assert result.outcome not in (GAP, NOT_APPLICABLE)


def test_a_reference_is_followed_without_drift_and_winds_nothing_up():
    """Against an ideal base, and against one that a wall stops."""
    reference, base = np.array([1.0, 2.0, 0.5]), np.array([1.0, 2.0, 0.5])
    for _ in range(10):
        base = base + 0.1 * driving.follow(reference, base, np.array([0.06, 0.12]), 0.1)
    # Ten chords of a circle of radius 0.5 m, a little longer than the arc's.
    turned = base - [1.0, 2.0, 0.5]
    assert turned[2] == pytest.approx(1.2)
    assert np.hypot(*turned[:2]) == pytest.approx(2 * 0.5 * np.sin(0.6), rel=2e-3)
    np.testing.assert_allclose(driving.follow(reference, base, np.zeros(2), 0.1), 0.0, atol=1e-12)
    np.testing.assert_allclose(driving.follow(reference, base - [0.001, 0, 0], np.zeros(2), 0.1), [0.01, 0.0, 0.0])
    reference, wall = np.zeros(3), np.zeros(3)
    for _ in range(50):
        velocity = driving.follow(reference, wall, np.array([0.06, 0.0]), 0.1)
    assert velocity[0] <= 0.6 + driving.LEAD / 0.1 + 1e-12
    assert driving.follow(reference, wall, np.array([-0.06, 0.0]), 0.1)[0] < 0.0  # off it at once
