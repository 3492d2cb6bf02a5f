"""Statistics against values worked out by hand, and against rliable's where it has them."""

from __future__ import annotations

import numpy as np
import pytest
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
    assert stats.pooled_iqm(list(x.T)) == pytest.approx(metrics.aggregate_iqm(x))
    assert stats.mean_probability_better(list(x.T), list(y.T)) == pytest.approx(
        metrics.probability_of_improvement(x, y)
    )


def test_a_bootstrap_repeats_and_leaves_the_global_generator_alone() -> None:
    strata = [np.random.default_rng(RNG_SEED).random(8)]
    before = np.random.get_state()[1].tolist()  # noqa: NPY002 - it must not have moved
    first, second = (stats.bootstrap_interval(stats.pooled_iqm, strata) for _ in range(2))
    assert first == second
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002
    assert first[0] < float(stats.pooled_iqm(strata)) < first[1]


def test_a_bootstrap_interval_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(RNG_SEED)
    hits = 0
    for _ in range(200):
        low, high = stats.bootstrap_interval(lambda s: s[0].mean(axis=-1), [rng.normal(size=20)])
        hits += low < 0 < high
    assert 0.88 <= hits / 200 <= 0.98  # 95%, less what a percentile bootstrap of 20 values lacks


def test_holm_corrects_for_the_number_of_pairs() -> None:
    # Every resample of A is above every one of B, so that pair is separated at any level; B and C are alike.
    a, b = np.arange(10.0, 15.0), np.arange(5.0)
    found = stats.compare_neighbours([[a], [b], [b]])
    assert [c.separated for c in found] == [True, False]
    assert (found[0].probability, found[0].bounds) == (1.0, (1.0, 1.0))
    assert found[1].probability == 0.5
    # A pair that its own 95% interval would separate, but not the wider one that five pairs ask for.
    x, y = np.arange(6.0) + 2.5, np.arange(6.0)
    alone = stats.compare_neighbours([[x], [y]])[0]
    together = stats.compare_neighbours([[x], [y], [y], [y], [y], [y]])[0]
    assert alone.bounds[0] > together.bounds[0]
    assert (alone.separated, together.separated) == (True, False)


def test_ranks_are_shared_until_a_pair_is_separated() -> None:
    assert stats.shared_ranks([]) == [1]
    assert stats.shared_ranks([False, True, False]) == [1, 1, 3, 3]
