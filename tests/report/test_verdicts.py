"""Verdicts on stated hypotheses: what they say, and when there is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats

from causalbench.report.columns import TABLES
from causalbench.report.comparison import compare, detectable_difference, holm, log_rank_scores
from causalbench.report.verdicts import verdict_rows
from causalbench.store.cells import State, Status, StoredCell
from causalbench.store.statements import Stated
from causalbench.suite.hypotheses import Statement

RNG_SEED = 41
LOW, HIGH = [0.0, 0.05, 0.1, 0.02, 0.08, 0.04], [0.6, 0.5, 0.7, 0.65, 0.55, 0.58]


def cell(method: str, backend: str, seed: int, state: State = "done") -> StoredCell:
    identity = {"kind": "learner", "backend": {"name": backend}, "method": {"name": method}, "seed": seed}
    return StoredCell(f"{backend}-{method}-{seed}", identity | {"grid_point": {}}, Status(state), Path("nowhere"))


def result(method: str, backend: str, seed: int, auc: float, **more: Any) -> dict[str, Any]:
    steps = {"steps_to_90": 1000 if auc > 0.3 else None, "budget": 5000}
    return {"method": method, "backend": backend, "seed": seed, "success_auc": auc} | steps | more


def judged(
    areas: dict[tuple[str, str], list[float]], *hypotheses: str, seeds: int = 6, before: bool = True,
    states: dict[tuple[str, str, int], State] | None = None, **budgets: int,
) -> dict[tuple[str, str, str], dict[str, Any]]:  # fmt: skip
    """(hypothesis, backend, measure) -> row; `areas` are by (method, backend), `budgets` by backend."""
    results = [
        result(m, b, s, auc, **({"budget": budgets[b]} if b in budgets else {}))
        for (m, b), values in areas.items()
        for s, auc in enumerate(values)
    ]
    cells = [cell(row["method"], row["backend"], row["seed"]) for row in results]
    cells += [cell(*key, state) for key, state in (states or {}).items()]
    backends = tuple(dict.fromkeys(backend for _, backend in areas))
    statement = Statement("s", "quick", hypotheses, backends, tuple(range(seeds)))
    rows = verdict_rows(results, cells, [Stated(statement, before)])
    assert all(tuple(row) == TABLES["verdicts.csv"] for row in rows)
    return {(row["hypothesis"], row["backend"], row["measure"]): row for row in rows}


def area_row(found: dict[tuple[str, str, str], dict[str, Any]], backend: str = "x") -> dict[str, Any]:
    (row,) = [row for (_, b, measure), row in found.items() if (b, measure) == (backend, "success_auc")]
    return row


@pytest.mark.parametrize(("left", "right", "verdict"), [(HIGH, LOW, "better"), (LOW, HIGH, "worse")])
def test_what_never_overlaps_is_better_or_worse(left: list[float], right: list[float], verdict: str) -> None:
    found = judged({("A", "x"): left, ("B", "x"): right}, "A > B")
    row = area_row(found)
    assert (row["verdict"], row["stated"], row["n_a"], row["n_b"], row["seeds_missing"]) == (verdict, 1, 6, 6, 0)
    assert row["difference"] == pytest.approx(np.mean(left) - np.mean(right))
    assert row["low"] < row["difference"] < row["high"]
    assert row["low"] * row["high"] > 0
    assert row["p_value"] == row["p_adjusted"] == pytest.approx(2 / 924)
    assert row["sentence"].startswith(
        f"A is {verdict} than B on x: a difference of {row['difference']:+.3f} in success"
    )


def test_steps_to_90_are_a_secondary_measure_and_count_who_never_got_there_as_censored() -> None:
    row = judged({("A", "x"): HIGH, ("B", "x"): LOW}, "A > B")["A > B", "x", "steps_to_90"]
    assert (row["verdict"], row["stated"], row["difference"], row["low"]) == ("better", 0, 4000, None)
    assert row["sentence"].startswith("Exploratory: A is better than B on x by steps to 90%: +4,000 environment steps")


@pytest.mark.parametrize("state", ["diverged", "failed", "timeout", "running", None])
def test_survivors_are_not_compared(state: State | None) -> None:
    states = {("A", "x", 5): state} if state else None
    row = area_row(judged({("A", "x"): HIGH[:5], ("B", "x"): LOW}, "A > B", states=states))
    assert (row["verdict"], row["p_value"], row["difference"], row["seeds_missing"]) == ("not decided", None, None, 1)
    told = state or "not started"
    assert row["sentence"] == f"A > B is not decided on x: 1 of 6 cells of A on x are not finished (1 {told})."


def test_all_backends_together_need_every_one_of_them_and_weigh_them_alike() -> None:
    areas = {("A", "x"): HIGH, ("B", "x"): LOW, ("A", "y"): LOW, ("B", "y"): LOW}
    found = judged(areas, "A > B")
    assert area_row(found, "all")["difference"] == pytest.approx((np.mean(HIGH) - np.mean(LOW)) / 2)
    assert [area_row(found, b)["verdict"] for b in ("all", "x", "y")] == ["better", "better", "not decided"]
    found = judged({key: values for key, values in areas.items() if key != ("B", "y")}, "A > B")
    assert [area_row(found, b)["verdict"] for b in ("all", "x", "y")] == ["not decided", "better", "not decided"]
    assert "6 of 6 cells of B on y are not finished (6 not started)" in area_row(found, "all")["sentence"]


def test_a_backend_on_which_nothing_ran_is_not_run() -> None:
    found = judged({("A", "x"): HIGH, ("B", "x"): LOW, ("C", "y"): LOW}, "A > B")
    assert [area_row(found, b)["verdict"] for b in ("all", "x", "y")] == ["not decided", "better", "not run"]


def test_areas_of_different_budgets_are_not_averaged() -> None:
    areas = {(m, b): v for b in ("x", "y") for m, v in (("A", HIGH), ("B", LOW))}
    found = judged(areas, "A > B", y=600)
    assert [area_row(found, b)["verdict"] for b in ("all", "x", "y")] == ["not decided", "better", "better"]
    assert area_row(found, "all")["sentence"].endswith("curves of different budgets are not averaged.")


def test_three_seeds_say_that_they_cannot_decide() -> None:
    row = area_row(judged({("A", "x"): HIGH[:3], ("B", "x"): LOW[:3]}, "A > B", seeds=3))
    assert (row["verdict"], row["low"], row["detectable"]) == ("not decided", None, None)
    assert row["sentence"].endswith("So few seeds cannot decide anything: no p-value of theirs is below 0.1.")


def test_every_stated_comparison_counts() -> None:
    areas = {(m, "x"): HIGH[:5] if m == "A" else LOW[:5] for m in "ABCDEFGH"}
    alone = area_row(judged(areas, "A > B", seeds=5))
    assert (alone["verdict"], alone["p_adjusted"]) == ("better", pytest.approx(2 / 252))
    among = judged(areas, *(f"A > {other}" for other in "BCDEFGH"), seeds=5)["A > B", "x", "success_auc"]
    assert (among["verdict"], among["p_adjusted"]) == ("not decided", pytest.approx(7 * 2 / 252))
    assert among["sentence"].endswith("below 0.0079, too much for the first of 7 comparisons.")


def test_equivalence_needs_a_stated_difference_and_enough_seeds() -> None:
    rng = np.random.default_rng(RNG_SEED)
    near = {("A", "x"): list(0.5 + 0.02 * rng.normal(size=6)), ("B", "x"): list(0.5 + 0.02 * rng.normal(size=6))}
    row = area_row(judged(near, "A == B within 0.1"))
    assert (row["verdict"], row["sentence"][:40]) == ("equivalent", "A and B are equivalent within 0.1 on x: ")
    assert area_row(judged(near, "A == B within 0.001"))["verdict"] == "not decided"
    far = area_row(judged({("A", "x"): HIGH, ("B", "x"): LOW}, "A == B within 0.1"))
    assert (far["verdict"], far["sentence"][:43]) == ("better", "A is better than B by more than 0.1 on x: a")


def test_what_was_stated_after_the_first_cell_is_exploratory() -> None:
    row = area_row(judged({("A", "x"): HIGH, ("B", "x"): LOW}, "A > B", before=False))
    assert row["stated"] == 0
    assert row["sentence"].startswith("Exploratory: A is better than B")


def test_holm_steps_down_and_what_cannot_be_compared_still_counts() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    found = holm([0.01, None, 0.5])
    assert (found[0], found[1], found[2]) == (pytest.approx(0.03), None, 1.0)


def test_pairs_are_taken_where_they_pay() -> None:
    rng = np.random.default_rng(RNG_SEED)
    luck, noise = rng.normal(size=10), 0.1 * rng.normal(size=(2, 10))
    alike = compare([luck + noise[0] + 0.3], [luck + noise[1]])
    assert alike.paired
    assert alike.correlation == pytest.approx(scipy.stats.pearsonr(luck + noise[0], luck + noise[1]).statistic)
    assert alike.shifts.two_sided() < 0.01 < compare([luck + noise[0] + 0.3], [luck[::-1]]).shifts.two_sided()
    assert not compare([luck[:5] + noise[0, :5]], [luck[:5] + noise[1, :5]]).paired


def test_the_detectable_difference_is_found_four_times_in_five() -> None:
    rng = np.random.default_rng(RNG_SEED)
    left, right = rng.normal(size=(2, 400, 8))
    expected = scipy.stats.t.ppf([0.975, 0.8], 14).sum() * np.sqrt(2 / 8)
    scale = np.sqrt((left[0].var(ddof=1) + right[0].var(ddof=1)) / 2)
    assert detectable_difference([left[0]], [right[0]], False, 0.05) == pytest.approx(expected * scale)
    power = (scipy.stats.ttest_ind(left + expected, right, axis=1).pvalue <= 0.05).mean()
    assert power == pytest.approx(0.8, abs=0.05)


def test_log_rank_scores_make_scipys_log_rank_statistic() -> None:
    x, y = [3.0, 5.0, 5.0, None, 8.0], [5.0, 9.0, None, None, 12.0, 2.0]
    scores = log_rank_scores([x, y])
    assert sum(map(np.sum, scores)) == pytest.approx(0.0)

    def censored(steps: list[float | None]) -> scipy.stats.CensoredData:
        return scipy.stats.CensoredData([s for s in steps if s], right=[20.0 for s in steps if s is None])

    # Permuting the sum of the first group's scores has the mean 0; scipy's statistic is that sum over its deviation.
    statistic = scipy.stats.logrank(censored(x), censored(y)).statistic
    times = np.array([20.0 if s is None else s for s in x + y])
    events = np.array([s is not None for s in x + y])
    group = np.array([True] * 5 + [False] * 6)
    variance = 0.0
    for time in np.unique(times[events]):
        risk, dead = (times >= time).sum(), (events & (times == time)).sum()
        share = (group & (times >= time)).sum() / risk
        variance += dead * share * (1 - share) * (risk - dead) / max(1, risk - 1)
    assert scores[0].sum() / np.sqrt(variance) == pytest.approx(statistic)
