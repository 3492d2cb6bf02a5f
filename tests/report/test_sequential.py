"""Looks: when a run that adds seeds stops, and that what is decided stays decided."""

from __future__ import annotations

import pytest
from looks import statement, told

from causalbench.suite.hypotheses import Statement

HIGH = [0.6, 0.5, 0.7, 0.65, 0.55, 0.58, 0.62, 0.57, 0.66, 0.61]
LOW = [0.0, 0.05, 0.1, 0.02, 0.08, 0.04, 0.03, 0.01, 0.07, 0.06]


@pytest.mark.parametrize(
    ("n_hypotheses", "backends", "seeds", "looks"),
    [
        # One backend: 2 / (2n choose n) is at most 0.05 / 4 from 5 seeds on, and 0.05 / 16 from 6 on.
        (1, "x", 10, (5, 7, 8, 10)),
        (4, "x", 10, (6, 7, 9, 10)),
        # Three together: 2 / 20^3 is at most 0.05 / 4 / 16.
        (4, "xyz", 10, (3, 5, 8, 10)),
        (4, "xyz", 3, (3,)),
        (1, "x", 2, (2,)),
    ],
)
def test_looks_begin_where_anything_can_be_decided(
    n_hypotheses: int, backends: str, seeds: int, looks: tuple[int, ...]
) -> None:
    hypotheses = tuple(f"A > {other}" for other in "BCDE"[:n_hypotheses])
    assert statement(hypotheses, tuple(backends), seeds).looks == looks


def test_a_clear_claim_stops_at_the_first_look() -> None:
    stated = statement(("A > B",))
    assert stated.looks == (4, 6, 8, 10)
    (row,), verdicts = told(stated, {"A": HIGH[:4], "B": LOW[:4]})
    assert (row["look"], row["spent"], row["decided"], row["undecided"], row["stops"]) == (1, 4, 1, 0, 1)
    assert row["reason"] == "stops: every hypothesis is decided, 6 of 10 seeds are saved"
    found = verdicts["A > B", "all"]
    assert (found["verdict"], found["n_a"], found["seeds_missing"]) == ("better", 8, 0)
    # Every backend's seeds regroup for themselves; three comparisons at four looks share the 5%.
    assert found["p_adjusted"] == pytest.approx(3 * 4 * 2 / 70**2)


def test_what_is_open_goes_on_until_the_seeds_are_used_up() -> None:
    stated = statement(("A > B", "A > C"))
    rows, verdicts = told(stated, {"A": HIGH, "B": LOW, "C": HIGH[::-1]})
    assert [(row["spent"], row["decided"], row["undecided"], row["stops"]) for row in rows] == [
        (4, 1, 1, 0), (6, 1, 1, 0), (8, 1, 1, 0), (10, 1, 1, 1),
    ]  # fmt: skip
    assert rows[0]["reason"] == "goes on: 1 of 2 hypotheses are not decided"
    assert rows[-1]["reason"] == "stops: the 10 seeds are used up"
    assert verdicts["A > C", "all"]["n_a"] == 20


def test_what_was_decided_stays_decided_whatever_comes_later() -> None:
    stated = statement(("A > B", "A > C"))
    areas = {"A": HIGH[:4] + [0.0] * 6, "B": LOW[:4] + [1.0] * 6, "C": HIGH[:4] + [0.0] * 6}
    _, verdicts = told(stated, areas)
    assert (verdicts["A > B", "all"]["verdict"], verdicts["A > B", "all"]["n_a"]) == ("better", 8)


def test_a_look_without_all_cells_decides_nothing_and_stops_where_nothing_else_is_open() -> None:
    stated = statement(("A > B",))
    (row,), verdicts = told(stated, {"A": HIGH[:4], "B": LOW[:4]}, {("B", "y", 102): "diverged"})
    assert (row["undecided"], row["stops"]) == (1, 1)
    assert row["reason"] == (
        "stops: what is not decided lacks cells, so 1 of 4 cells of B on y are not finished (1 diverged)"
    )
    assert verdicts["A > B", "all"]["verdict"] == "not decided"


def test_a_statement_without_looks_has_none() -> None:
    plain = Statement("s", "full", ("A > B",), ("x",), (100, 101))
    assert told(plain, {"A": HIGH[:2], "B": LOW[:2]})[0] == []
