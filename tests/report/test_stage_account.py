"""The account of progress reversal against answers worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from stored import episode

from causalbench.report.stage_account import latching, measures, moves, progress_account, stage_account
from causalbench.store.episodes import episode_row

CELL = {"task": "t", "backend": "b", "method": "m", "grid_point": "", "seed": 0}


def frame(*episodes: Any) -> pd.DataFrame:
    return pd.DataFrame([CELL | episode_row(found) for found in episodes])


PLAYED = frame(
    episode("1x2 2x3 3x2", 4, held=True),  # straight to a success that held
    episode("1x2 2x3 1x1 2x2 3x1", 4, held=False),  # fell once, came back, and let go of its success
    episode("1x1 2x2 3x4 2x1 3x1 1x6", 1),  # fell from 3, came back, fell to the start
    episode("1x9", 1),  # never left
    episode("1x1 3x1", 1, deterministic=False),  # sampled: not looked at
)


def account(stage: int) -> dict[str, Any]:
    (row,) = [row for row in stage_account(PLAYED) if row["stage"] == stage]
    return row


@pytest.mark.parametrize(
    ("stage", "expected"),
    [
        # reached, held, fell back, recovered, lost, falls, steps in the stage, steps below it
        (1, (4, 4, 0, 0, 0, 0, 2 + 3 + 7 + 9, 0)),
        (2, (3, 1, 2, 1, 1, 2, 3 + 5 + 3, 1 + 6)),
        (3, (3, 2, 1, 0, 1, 2, 2 + 1 + 5, 1 + 6)),
        (4, (2, 1, 1, 0, 1, 1, 0, 0)),
    ],
)
def test_what_became_of_a_stage(stage: int, expected: tuple[int, ...]) -> None:
    row = account(stage)
    names = (
        "episodes_reached", "episodes_held", "episodes_fell_back", "episodes_recovered", "episodes_lost", "falls",
        "steps_in_stage", "steps_below",
    )  # fmt: skip
    assert tuple(row[name] for name in names) == expected
    assert row["episodes"] == 4


def test_every_stage_reached_is_held_recovered_or_lost() -> None:
    rng, played = np.random.default_rng(5), []
    for _ in range(60):
        stages = rng.integers(1, 4, size=rng.integers(1, 30))
        final = int(rng.integers(1, 5))
        text = " ".join(f"{stage}x1" for stage in stages)
        played.append(episode(text, final, held=bool(rng.integers(2)) if final == 4 else None))
    for row in stage_account(frame(*played)):
        assert row["episodes_reached"] == row["episodes_held"] + row["episodes_fell_back"]
        assert row["episodes_fell_back"] == row["episodes_recovered"] + row["episodes_lost"]
        assert row["falls"] >= row["episodes_fell_back"]
    steps = sum(row["steps_in_stage"] for row in stage_account(frame(*played)))
    assert steps == sum(found.length for found in played) == sum(row["count"] for row in moves(frame(*played)))


def test_moves_are_counted_step_by_step() -> None:
    counts = {(row["from_stage"], row["to_stage"]): row["count"] for row in moves(frame(episode("1x3 2x2 1x1", 1)))}
    assert counts == {(1, 1): 3, (1, 2): 1, (2, 2): 1, (2, 1): 1}


@pytest.mark.parametrize(
    ("progress", "expected"),
    [
        # largest, final, regression loss, efficiency, drawdown, recovered
        ([0, 0.5, 1], (1, 1, 0, 1, 0, np.nan)),
        ([0, 0, 0], (0, 0, 0, 0, 0, np.nan)),
        ([0, 0.5, 0.25, 0.5, 1], (1, 1, 0.0625, 1 / 1.5, 0.25, 1)),
        ([0, 1, 0, 0.5], (1, 0.5, 0.5, 1 / 2.5, 1, 0.5)),
        ([0, 0.5, 0, 0], (0.5, 0, (0.5 + 0.5) / 3 / 0.5, 0.25, 0.5, 0)),
        ([0, 0.75, 0.25, 1, 0.5, 0.5], (1, 0.5, (0.5 + 0.5 + 0.5) / 5, 1 / 2.5, 0.5, 1)),
    ],
)
def test_measures_of_progress(progress: list[float], expected: tuple[float, ...]) -> None:
    names = (
        "largest_progress", "final_progress", "regression_loss", "path_efficiency", "largest_drawdown",
        "drawdown_recovered",
    )  # fmt: skip
    found = measures(np.array(progress, dtype=float))
    np.testing.assert_allclose([found[name] for name in names], expected)


def test_a_cell_has_the_means_of_its_episodes() -> None:
    (row,) = progress_account(PLAYED)
    assert row | CELL == row
    assert (row["episodes"], row["episodes_with_drawdown"]) == (4, 2)
    assert row["largest_progress"] == pytest.approx((1 + 1 + 2 / 3 + 0) / 4)
    assert row["final_progress"] == pytest.approx((1 + 1 + 0 + 0) / 4)
    assert row["largest_drawdown"] == pytest.approx((1 / 3 + 2 / 3) / 4)
    assert row["drawdown_recovered"] == pytest.approx((1 + 0) / 2)
    (calm,) = progress_account(frame(episode("1x2 2x2", 2)))
    assert calm["drawdown_recovered"] is None


def test_what_rules_that_remember_would_add() -> None:
    rows = {(row["rule"], row["threshold"]): row for row in latching(PLAYED)}
    assert {key: (row["latched"], row["at_end"]) for key, row in rows.items() if key[0] == "peak_progress"} == {
        ("peak_progress", 1 / 3): (0.75, 0.5),
        ("peak_progress", 2 / 3): (0.75, 0.5),
    }
    assert rows["peak_progress", 2 / 3]["points"] == 25
    milestones = rows["recorded_milestones", None]
    assert (milestones["latched"], milestones["at_end"]) == (pytest.approx(8 / 12), 0.5)
    once = rows["success_once", None]
    assert (once["latched"], once["at_end"], once["points"]) == (0.5, 0.25, 25)


def test_a_success_without_a_test_is_kept() -> None:
    rows = {row["rule"]: row for row in latching(frame(episode("1x1 2x1 3x1", 4)))}
    assert rows["success_once"]["points"] == 0
    assert rows["success_once"]["at_end"] == 1


def test_cells_are_apart() -> None:
    other = frame(episode("1x4", 1)).assign(method="n", seed=3)
    found = stage_account(pd.concat([PLAYED, other]))
    assert [(row["method"], row["seed"]) for row in found] == [("m", 0)] * 4 + [("n", 3)] * 4
