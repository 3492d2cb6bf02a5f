"""What sections say, against answers that are known."""

from __future__ import annotations

import base64
import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.integrate

from causalbench.report import stats
from causalbench.report.html import causes, controls, curves, failures, flow, reversal, transitions, verdicts
from causalbench.report.html.parts import Download, Matrix, Table, Verdict
from causalbench.report.html.source import Source


def learned(seeds: list[list[float]], prices: list[int]) -> Any:
    """A source of one method with evaluations at 50 and 100 of 100 steps."""
    keys = {"task": "t", "backend": "b", "method": "m", "grid_point": ""}
    results = [keys | {"seed": i, "budget": 100, "discovery_env_steps": price} for i, price in enumerate(prices)]
    rows = [
        keys | {"seed": i, "env_steps": 50 * (k + 1), "success_deterministic": value}
        for i, values in enumerate(seeds)
        for k, value in enumerate(values)
    ]
    return SimpleNamespace(tables=SimpleNamespace(results=pd.DataFrame(results), curves=pd.DataFrame(rows)))


def test_the_area_under_a_shown_curve_is_the_seeds_area() -> None:
    seeds = [[0.2, 1.0], [0.6, 0.8]]
    shown = curves.bands(learned(seeds, [0, 0]), with_discovery=False)
    area = scipy.integrate.trapezoid(shown["success"], shown["env_steps"])
    assert area / 100 == pytest.approx(np.mean([stats.area_under([50, 100], values, 100) for values in seeds]))
    assert list(shown["env_steps"]) == [0, 50, 100]
    assert (list(shown["least"]), list(shown["most"])) == ([0.0, 0.2, 0.8], [0.0, 0.6, 1.0])
    assert shown[["low", "high"]].isna().all(axis=None)  # two seeds have no interval


def test_the_price_of_a_discovery_comes_before_the_curve() -> None:
    shown = curves.bands(learned([[1.0, 1.0]], [30]), with_discovery=True).set_index("env_steps")["success"]
    assert dict(shown) == {0: 0.0, 30: 0.0, 80: 1.0, 130: 1.0}


@pytest.mark.parametrize(("n", "interval"), [(5, None), (6, (0.1, 0.9)), (9, (0.2, 0.9))])
def test_from_six_seeds_on_a_curve_has_the_interval_of_its_median(n: int, interval: tuple[float, float] | None) -> None:
    seeds = [[0.0, value] for value in (0.1, 0.2, 0.3, 0.4, 0.8, 0.9, 0.9, 0.9, 1.0)[:n]]
    last = curves.bands(learned(seeds, [0] * n), with_discovery=False).iloc[-1]
    assert last["success"] == pytest.approx(np.median([values[-1] for values in seeds]))
    assert (None if np.isnan(last["low"]) else (last["low"], last["high"])) == interval


def test_hypotheses_come_first_with_their_sentences(source: Source) -> None:
    blocks = verdicts.section(source).blocks
    stated = [block for block in blocks if isinstance(block, Verdict)]
    # m stands at two points of a grid on kinematic, so only physical can be judged.
    assert [(one.backend, one.word) for one in stated] == [("", "not decided"), ("", "not decided")]
    each = [block.blocks for block in blocks if getattr(block, "title", "").startswith("By backend: ")]
    assert [[one.word for one in verdicts] for verdicts in each] == [
        ["not decided", "better"],
        ["not decided", "worse"],
    ]
    assert each[0][1].sentence.startswith("cm is better than m on physical: a difference of +")


def test_stages_are_added_up_over_seeds(source: Source) -> None:
    rows = flow.pooled(source.tables.stage_account).query("backend == 'physical' and method == 'cm'")
    assert list(rows["stage"]) == [1, 2, 3, 4]
    # Per seed: one episode falls from 2 to 1 and succeeds, one ends in stage 1 after it was in 2.
    second = rows.set_index("stage").loc[2]
    counts = ["episodes", "episodes_reached", "episodes_held", "episodes_recovered", "episodes_lost", "falls"]
    assert list(second[counts]) == [10, 10, 0, 5, 5, 10]
    assert list(rows["episodes_held"]) == [10, 0, 5, 5]


def test_what_is_saved_is_no_formula_and_reads_back() -> None:
    frame = pd.DataFrame({"name": ["=1+1", "-0.5", "b"], "n": pd.array([0.1, None, 3.0], dtype="Float64")})
    content = base64.b64decode(Download.csv("x.csv", frame).href.partition("base64,")[2]).decode()
    assert content == "name,n\n'=1+1,0.1\n-0.5,\nb,3.0\n"


def test_every_reached_episode_has_one_fate(source: Source) -> None:
    rows = flow.pooled(source.tables.stage_account)
    assert (rows[list(flow.FATES)].sum(axis=1) == rows["episodes_reached"]).all()


def test_points_that_latching_adds_stand_in_a_column_per_rule(source: Source) -> None:
    (table,) = [block for block in reversal.section(source).blocks if getattr(block, "title", "").startswith("Points")]
    row = next(row for row in table.rows if (row.backend, row.values[1].text) == ("physical", "cm"))
    found = {column.name: value.text for column, value in zip(table.columns, row.values, strict=True)}
    # Half of the episodes were beyond a third once and end below it.
    assert found["peak progress ≥ 0.33"] == "50.0"
    assert found["success once"] == "0.0"


def test_the_share_of_reversals_that_vanish_stands_with_its_interval(source: Source) -> None:
    blocks = reversal.section(source).blocks
    (table,) = [block for block in blocks if getattr(block, "title", "").startswith("Reversals that vanish")]
    assert [row.backend for row in table.rows] == ["physical", "physical"]
    mean, episodes, reversals, repeated, redundant, causes_ = (value.text for value in table.rows[0].values[2:])
    assert (mean, episodes, reversals, repeated) == ("mean", "20", "40", "40")  # five seeds of four episodes
    assert redundant.startswith("60% (")
    assert causes_ == "0% (0 to 0%)"


def test_without_an_account_the_page_says_how_to_get_one(source: Source) -> None:
    nothing = dataclasses.replace(source.tables, reversals=source.tables.reversals.iloc[:0])
    blocks = reversal.section(dataclasses.replace(source, tables=nothing)).blocks
    texts = [getattr(block, "text", "") for block in blocks]
    assert any(text.endswith("causalbench reversals run") for text in texts)


def test_ways_are_rates_of_all_steps_of_a_method(source: Source) -> None:
    table = transitions.rates(source.tables.moves).query("backend == 'physical' and method == 'cm'")
    rates = dict(zip(zip(table["from_stage"], table["to_stage"], strict=True), table["rate"], strict=True))
    # Per seed 8 steps "1x2 2x2 1x1 2x3" and success, 6 steps "1x4 2x2" and back to stage 1.
    expected = {(1, 2): 3, (2, 1): 2, (2, 4): 1}
    assert rates == pytest.approx({way: 1000 * count / 14 for way, count in expected.items()})
    (drawn,) = [found for found in transitions.multiples(source) if found.backend == "physical"]
    assert drawn.alts[0].endswith("led from stage to stage: 1 to 2 214, 2 to 1 143, 2 to 4 71.")


def test_the_matrix_takes_the_majority_and_says_who_differs(source: Source) -> None:
    edges = causes.majority(source)
    split = edges[edges["selected"] == 1]
    assert set(split["action"]) == {"armx"}
    assert set(edges["seeds"]) == {2}
    matrices = [block for block in causes.section(source).blocks if isinstance(block, Matrix)]
    assert [matrix.backend for matrix in matrices] == ["kinematic", "physical"]
    squares = {square.sentence: square for _, row in matrices[0].rows for square in row}
    halved = [square for square in squares.values() if "1/2" in square.more]
    assert halved
    assert {square.state for square in halved} == {"human"}  # one of two is no majority


def test_scores_against_the_oracle_count_missed_edges(source: Source) -> None:
    tables = [block for block in causes.section(source).blocks if isinstance(block, Table)]
    (scores,) = [table for table in tables if table.title.startswith("Against the oracle")]
    (agreement,) = [table for table in tables if table.title.startswith("Agreement")]
    whole = next(row for row in scores.rows if row.values[1].text == "all" and row.backend == "physical")
    missed = int((causes.majority(source).query("backend == 'physical'")["selected"] == 1).sum())
    assert [value.text for value in whole.values[-2:]] == [str(missed), "0"]
    assert agreement.rows[0].values[-1].text == "none"


def test_no_false_discovery_has_an_interval_all_the_same(source: Source) -> None:
    (table,) = [block for block in controls.section(source).blocks if isinstance(block, Table)]
    n = int((source.tables.discovery.query("backend == 'physical'")["oracle_grade"] == "absent").sum())
    low, high = stats.wilson(0, n)
    assert table.rows[1].values[-1].text == f"0.0% [{100 * low:.1f}, {100 * high:.1f}]"


def test_failures_and_skipped_cells_are_named(source: Source) -> None:
    section = failures.section(source)
    assert "1 failed" in section.blocks[0].text
    (table,) = [block for block in section.blocks if getattr(block, "title", "") == "Cells that are not done"]
    assert sorted(row.values[0].text for row in table.rows) == ["failed", "skipped"]
