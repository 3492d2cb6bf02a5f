"""The leaderboard to paste: what it says, and that no name breaks out of its cell."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from causalbench.report.columns import TABLES
from causalbench.report.pastable import latex, leaderboard_md, leaderboard_tex, markdown

NAMES = ["a|b", "50% of $x_1$ & {y} #2 ~ ^ \\", "<b>`*_[link](http://x)", "two\nlines", r"\input{/etc/passwd}"]


def board(verdict: str) -> pd.DataFrame:
    row = dict.fromkeys(TABLES["leaderboard.csv"])
    row |= {"backend": "b", "rank": 1, "method": "m", "grid_point": "", "seeds": 5, "budget": 80_000}
    row |= {
        "success_auc_iqm": 0.5,
        "success_auc_lowest": 0.4,
        "success_auc_highest": 0.6,
        "success_deterministic": 0.9,
    }
    return pd.DataFrame([row | {"steps_to_90": None, "steps_to_90_with_discovery": 1200.0, "verdict": verdict}])


@pytest.mark.parametrize("name", NAMES)
def test_a_row_of_markdown_has_as_many_cells_as_its_heading(name: str) -> None:
    lines = leaderboard_md(board(name)).splitlines()
    assert len(lines) == 3
    assert {len(re.findall(r"(?<!\\)(?:\\\\)*\|", line)) for line in lines} == {10}
    assert not re.search(r"(?<!\\)[<`*\[]", lines[2].partition("0.90")[2])


@pytest.mark.parametrize("name", NAMES)
def test_latex_has_no_command_that_a_name_brought(name: str) -> None:
    lines = leaderboard_tex(board(name)).splitlines()
    (row,) = lines[5:-2]
    assert len(re.findall(r"(?<!\\)&", row)) == 8
    assert row.endswith(r" \\")
    assert set(re.findall(r"\\[a-zA-Z]+", row)) <= {
        r"\textbackslash", r"\textasciitilde", r"\textasciicircum", r"\textless", r"\textgreater", r"\textbar",
    }  # fmt: skip
    assert not re.search(r"(?<!\\)[%$#_~^]", row)


def test_numbers_are_those_of_the_leaderboard() -> None:
    assert leaderboard_md(board("fine")).splitlines()[2] == (
        r"| b | 1 | m | 5 | 0.500 \[0.400, 0.600\] | 0.90 | \>80000 | 1200 | fine |"
    )
    assert r"b & 1 & m & 5 & 0.500 [0.400, 0.600] & 0.90 & \textgreater{}80000 & 1200 & fine \\" in leaderboard_tex(
        board("fine")
    )


def test_plain_words_stay_plain() -> None:
    assert markdown("better than mSAC") == latex("better than mSAC") == "better than mSAC"
