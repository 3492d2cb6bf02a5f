"""Warnings: each bad decomposition of pure manipulation gets the warning that it deserves and no other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from causalbench.conformance.check import FAIL, WARNING, Check, run_check
from causalbench.conformance.task_bench import TaskBench
from causalbench.conformance.task_suite import TASK_CHECKS, TASK_WARNINGS
from causalbench.core.tasks.changes.decompositions import DECOMPOSITIONS
from causalbench.plugins.manager import installed

SOUND = "pure_manipulation"
WARNED = {
    "W1": "sliver",
    "W2": "level",
    "W3": "misplaced",
    "W4": "unshaped",
    "W5": "split",
    "W6": "idle",
    "W7": "swapped",
}
"""Number -> the decomposition that is warned of so, and in no other way."""


def outcomes(task: str, checks: tuple[Check, ...]) -> dict[str, str]:
    """Number -> outcome of what does not hold on kinematic."""
    bench = TaskBench(installed().task(task), installed().backend("kinematic"))
    found = [run_check(check, bench) for check in checks]
    bench.close()
    return {result.number: result.outcome for result in found if result.outcome in (FAIL, WARNING)}


def test_every_warning_has_its_decomposition() -> None:
    assert list(WARNED) == [check.number for check in TASK_WARNINGS]
    assert {*WARNED.values()} <= {*DECOMPOSITIONS}


@pytest.mark.parametrize("check", TASK_WARNINGS, ids=lambda check: check.number)
def test_a_bad_decomposition_is_warned_of(check: Check) -> None:
    assert outcomes(f"{SOUND}+{WARNED[check.number]}", (check,)) == {check.number: WARNING}


@pytest.mark.long
@pytest.mark.parametrize("number", WARNED)
def test_it_is_warned_of_in_no_other_way(number: str) -> None:
    assert outcomes(f"{SOUND}+{WARNED[number]}", TASK_WARNINGS) == {number: WARNING}


def test_the_sound_task_is_not_warned_of() -> None:
    assert outcomes(SOUND, TASK_WARNINGS) == {}


@pytest.mark.long
@pytest.mark.parametrize("name", ["merged", "split", "sliver", "halved", "swapped", "misplaced"])
def test_bad_decompositions_keep_the_contract(name: str) -> None:
    """But for new processes: what is wrong with them is no line of it."""
    checks = tuple(check for check in TASK_CHECKS if check.number not in ("T2", "T3"))
    assert outcomes(f"{SOUND}+{name}", checks) == {}


def test_the_documentation_lists_the_same_warnings() -> None:
    text = (Path(__file__).parents[2] / "docs" / "task_conformance.md").read_text()
    lines = re.findall(r"^\*\*(W\d+)\.\*\* (.+)$", text, re.MULTILINE)
    assert lines == [(check.number, check.sentence) for check in TASK_WARNINGS]
