"""Statistics against values worked out by hand, and against rliable's where it has them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats
from rliable import metrics

from causalbench.report import stats

RNG_SEED = 20


def test_wilson_interval_of_known_counts() -> None:
    # 8 of 10: centre (0.8 + 1.92073/10) / 1.384146, half width 1.959964 / 1.384146 * sqrt(0.016 + 0.0096036).
    assert stats.wilson(8, 10) == pytest.approx((0.490162, 0.943318), abs=1e-6)
    assert stats.wilson(0, 10) == pytest.approx((0.0, 0.277533), abs=1e-6)
    assert stats.wilson(10, 10)[1] == pytest.approx(1.0)


def test_area_starts_from_zero_at_step_zero_and_is_divided_by_the_budget() -> None:
    # A triangle up to (100, 0.5), then a trapezoid to (200, 1.0): 25 + 75 of 200.
    assert stats.area_under([100, 200], [0.5, 1.0], 200) == pytest.approx(0.5)
    assert stats.area_under([200], [1.0], 200) == pytest.approx(0.5)
    assert stats.area_under([100, 200], [1.0, 1.0], 200) == pytest.approx(0.75)


def test_iqm_cuts_a_quarter_at_each_end() -> None:
    assert stats.iqm(np.array([100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -100.0])) == pytest.approx(3.5)
    assert stats.iqm(np.array([0.0, 1.0, 5.0])) == pytest.approx(2.0)  # 3 // 4 = 0: nothing to cut


def test_probability_better_counts_a_tie_as_half() -> None:
    assert stats.probability_better(np.array([1.0, 2.0]), np.array([1.0, 0.0])) == pytest.approx((0.5 + 1 + 1 + 1) / 4)


def test_point_estimates_equal_those_of_rliable() -> None:
    rng = np.random.default_rng(RNG_SEED)
    x, y = rng.random((7, 3)), rng.random((6, 3)).round(1)
    for column in x.T:
        assert stats.mean_iqm([column]) == pytest.approx(metrics.aggregate_iqm(column[:, None]))
    assert stats.mean_probability_better(list(x.T), list(y.T)) == pytest.approx(
        metrics.probability_of_improvement(x, y)
    )


def test_backends_weigh_alike_whatever_their_number_of_seeds() -> None:
    assert stats.mean_iqm([np.array([1.0] * 10), np.array([0.0])]) == 0.5


def test_the_interval_of_a_median_covers_it_as_often_as_it_says() -> None:
    assert np.isnan(stats.median_interval(np.arange(5.0))).all()  # [lowest, highest] of five holds it with 0.9375
    assert stats.median_interval(np.arange(6.0)) == (0.0, 5.0)  # with 1 - 2 / 2^6
    assert stats.median_interval(np.arange(10.0)) == (1.0, 8.0)  # with 1 - 2 (1 + 10) / 2^10
    rng = np.random.default_rng(RNG_SEED)
    for n in (6, 7, 10, 13):
        values = rng.exponential(size=(2000, n))
        low, high = stats.median_interval(values)
        assert ((low < np.log(2)) & (np.log(2) < high)).mean() > 0.94
        expected = scipy.stats.quantile_test(values[0], p=0.5).confidence_interval(0.95)
        assert (low[0], high[0]) == (expected.low, expected.high)


def test_the_tolerance_is_the_share_that_the_range_of_so_many_holds() -> None:
    # P(range of n holds at least a share p) = 1 - n p^(n - 1) + (n - 1) p^n.
    for n in (2, 3, 5, 10):
        p = stats.tolerance(n)
        assert 1 - n * p ** (n - 1) + (n - 1) * p**n == pytest.approx(0.95)
    assert stats.tolerance(1) == 0
