"""`run --until-decided`: which seeds run, what it says, and what it leaves behind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from stored import finished

from causalbench.cli import until_decided
from causalbench.cli.until_decided import execute_until_decided
from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.report.tables import write_tables
from causalbench.store.run_folder import RunFolder
from causalbench.suite.plan import Plan, make_plan
from causalbench.suite.schema import load_suite

SUITE = """\
schema: 1
name: demo
task: pure_manipulation
backends: [kinematic]
methods: [cmmSAC, mSAC]
tiers:
  full: {seeds: 10, env_steps: 100}
first_seed: 100
"""
HYPOTHESES = "hypotheses: [cmmSAC > mSAC]\n"


def plan_of(folder: Path, text: str) -> Plan:
    path = folder / "demo.yaml"
    path.write_text(text)
    return make_plan(load_suite(path, installed()), "full", installed())


@pytest.mark.parametrize(("success", "looks", "reason"), [
    (0.8, [5], "Look 1, 5 seeds: stops: every hypothesis is decided, 5 of 10 seeds are saved."),
    (0.0, [5, 7, 8, 10], "Look 4, 10 seeds: stops: the 10 seeds are used up."),
])  # fmt: skip
def test_seeds_are_added_until_the_hypothesis_is_decided(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], success: float,
    looks: list[int], reason: str,
) -> None:  # fmt: skip
    ran: list[int] = []

    def execute(part: Plan, run: RunFolder, *_: Any) -> None:
        with run.claim():
            run.state(part.statement)
            for cell in part.cells:
                if run.status(cell).state != "done":
                    finished(run, success * (cell.method.name == "cmmSAC"), **cell.identity)
        ran.append(len({cell.seed for cell in part.cells}))

    monkeypatch.setattr(until_decided, "execute", execute)
    run = RunFolder(tmp_path / "run")
    done = execute_until_decided(plan_of(tmp_path, SUITE + HYPOTHESES), run, None, None, quiet=True)
    assert ran == looks
    assert {cell.seed for cell in done.cells} == set(range(100, 100 + looks[-1]))
    _, board = write_tables(run)["leaderboard.csv"]
    assert [row["seeds"] for row in board] == [looks[-1]] * 2
    assert not any("not ranked" in row["verdict"] for row in board), "seeds that were saved are not missing"
    assert capsys.readouterr().err.splitlines()[-1] == reason
    (stated,) = run.stated()
    assert (stated.before_any_cell, stated.statement.looks) == (True, (5, 7, 8, 10))


def test_a_suite_without_hypotheses_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--until-decided: this suite states no hypotheses"):
        execute_until_decided(plan_of(tmp_path, SUITE), RunFolder(tmp_path / "run"), None, None, quiet=True)
