"""Warnings of a decomposition from a run's tables alone."""

from __future__ import annotations

import pandas as pd
import pytest
from stored import episode

from causalbench.report.columns import TABLES
from causalbench.report.decomposition_warnings import decomposition_warnings
from causalbench.report.stage_account import stage_account
from causalbench.store.episodes import episode_row

CELL = {"task": "t", "backend": "b", "method": "m", "grid_point": "", "seed": 0}


def edges(*grades: str) -> pd.DataFrame:
    """A discovery of one term in stage 2, whose oracle says `grades`, one an action."""
    rows = [{"task": "t", "backend": "b", "stage": 2, "term": "r", "oracle_grade": grade} for grade in grades]
    return pd.DataFrame(rows, columns=list(TABLES["discovery.csv"]))


def said(found: pd.DataFrame, *played: tuple[str, int, float]) -> list[str]:
    """The warnings of a run that discovered `found` and played episodes (trace, final stage, return)."""
    rows = [CELL | episode_row(episode(trace, last)) | {"return": paid} for trace, last, paid in played]
    frame = pd.DataFrame(rows, columns=[*TABLES["episodes.csv"]])
    account = pd.DataFrame(stage_account(frame), columns=list(TABLES["stage_account.csv"]))
    return decomposition_warnings(found, account, frame)


STRAIGHT, STUCK = ("1x2 2x3 3x2", 4, 10.0), ("1x9", 1, 1.0)


@pytest.mark.parametrize(
    ("found", "played", "warning"),
    [
        (edges("absent", "absent"), [STRAIGHT], "t on b: no action causes r in stage 2"),
        (edges("untestable", "untestable"), [STRAIGHT], "t on b: r never varied in stage 2"),
        (edges("strong"), [("1x2 3x2", 4, 10.0), STUCK], "beyond stage 2, and none spent a step in it"),
        (edges("strong"), [STRAIGHT, ("1x1 2x1 1x1 2x1", 1, 30.0)], "1 of 1 episodes that failed earned more"),
    ],
)
def test_what_is_bad_is_said(found: pd.DataFrame, played: list[tuple[str, int, float]], warning: str) -> None:
    (sentence,) = said(found, *played)
    assert warning in sentence


def test_nothing_is_said_of_a_sound_run() -> None:
    assert said(edges("absent", "strong", "weak"), STRAIGHT, STUCK) == []


def test_a_stage_that_nobody_got_to_is_no_fault_of_the_decomposition() -> None:
    assert said(edges("strong"), STUCK) == []


def test_a_run_without_discovery_or_episodes_says_nothing() -> None:
    assert said(edges()) == []
