"""Regroupings against scipy's permutation test, and against what can be counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

from causalbench.report import permutation
from causalbench.report.permutation import least_p, regroup

RNG_SEED = 40


def samples(*sizes: int) -> list[np.ndarray]:
    rng = np.random.default_rng(RNG_SEED)
    return [rng.random(n).round(2) for n in sizes]


@pytest.mark.parametrize(("n", "m"), [(3, 3), (5, 5), (4, 7), (10, 10)])
def test_p_values_are_those_of_scipy(n: int, m: int) -> None:
    left, right = samples(n, m)

    def expected(alternative: str, shift: float = 0.0) -> float:
        return scipy.stats.permutation_test(
            (left - shift, right), lambda x, y, axis: x.mean(axis) - y.mean(axis), vectorized=True,
            n_resamples=np.inf, alternative=alternative,
        ).pvalue  # fmt: skip

    found = regroup([left], [right])
    shifts = found.shifts()
    assert shifts.two_sided() == pytest.approx(expected("two-sided"))
    assert found.two_sided == pytest.approx(expected("two-sided"))
    if n < 10:
        for shift in (0.0, 0.07, -0.2):
            assert shifts.p_greater(shift) == pytest.approx(expected("greater", shift))
            assert shifts.p_less(shift) == pytest.approx(expected("less", shift))


def test_pairs_change_their_sign_as_scipy_says() -> None:
    left, right = samples(8, 8)
    expected = scipy.stats.permutation_test(
        (left - right,), lambda x, axis: x.mean(axis), permutation_type="samples", vectorized=True, n_resamples=np.inf
    )
    assert regroup([left], [right], paired=True).shifts().two_sided() == pytest.approx(expected.pvalue)


@pytest.mark.parametrize("paired", [False, True])
def test_the_interval_ends_where_the_test_of_a_shift_changes_its_mind(paired: bool) -> None:
    left, right = samples(7, 7)
    shifts = regroup([left], [right], paired).shifts()
    low, high = shifts.interval(0.05)
    assert shifts.p_greater(low) > 0.025 >= shifts.p_greater(low - 1e-6)
    assert shifts.p_less(high) > 0.025 >= shifts.p_less(high + 1e-6)
    assert low < shifts.difference < high


def test_seeds_that_cannot_refute_anything_have_no_interval() -> None:
    apart = [np.array([0.9, 0.91, 0.92])], [np.array([0.0, 0.01, 0.02])]
    shifts = regroup(*apart).shifts()
    assert shifts.two_sided() == pytest.approx(2 / 20) == least_p([(3, 3, False)])
    assert shifts.interval(0.05) is None
    assert shifts.interval(0.1) is not None


def test_backends_are_regrouped_each_for_itself() -> None:
    # All of 6 x 6 regroupings, counted by hand: only the observed one has all left values on the left.
    left, right = [np.array([3.0, 4.0]), np.array([7.0, 9.0])], [np.array([1.0, 2.0]), np.array([5.0, 6.0])]
    shifts = regroup(left, right).shifts()
    assert shifts.total == 36
    assert shifts.difference == pytest.approx((2.0 + 2.5) / 2)
    assert shifts.p_greater() == pytest.approx(1 / 36)
    assert shifts.two_sided() == pytest.approx(2 / 36) == least_p([(2, 2, False)] * 2)


def test_equivalence_is_two_one_sided_tests() -> None:
    left, right = samples(8, 8)
    shifts = regroup([left], [right]).shifts()
    inside = regroup([left - 0.3], [right]).shifts().p_less(), regroup([left + 0.3], [right]).shifts().p_greater()
    assert shifts.equivalence(0.3) == pytest.approx(max(inside))
    assert shifts.equivalence(0.9) < 0.001 < shifts.equivalence(0.001)


def test_regroupings_beyond_the_most_are_drawn_and_repeat() -> None:
    left, right = samples(6, 6)
    exact = regroup([left], [right]).shifts()
    first, second = (regroup([left], [right], most=900).shifts() for _ in range(2))
    assert first.total == permutation.DRAWS + 1
    assert np.array_equal(first.sorted, second.sorted)
    assert first.two_sided() == pytest.approx(exact.two_sided(), abs=0.01)
    assert first.interval(0.05) == pytest.approx(exact.interval(0.05), abs=0.02)


def test_many_data_sets_are_tested_at_once() -> None:
    left, right = np.random.default_rng(RNG_SEED).random((2, 4, 5))
    each = [regroup([a], [b]).shifts().two_sided() for a, b in zip(left, right, strict=True)]
    assert regroup([left], [right]).two_sided == pytest.approx(each)
