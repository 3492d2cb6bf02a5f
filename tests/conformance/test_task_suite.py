"""The contract of tasks: a task that is wrong in one way fails exactly that line, those that come along none."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from conformance.broken_tasks import BROKEN, CAR, HOVER

from causalbench.conformance.check import Check, Result, run_check
from causalbench.conformance.task_bench import TaskBench
from causalbench.conformance.task_suite import TASK_CHECKS, TASK_WARNINGS
from causalbench.core.tasks.stage_task import StageTask
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import venue_of

NUMBERS = [check.number for check in TASK_CHECKS]
IN_NEW_PROCESSES = frozenset({"T2", "T3"})


@pytest.fixture(autouse=True)
def known_ids(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two examples are not installed here."""
    ids = {task.env_id: task.name for task in (HOVER, CAR, *installed().tasks.values())}
    monkeypatch.setattr("causalbench.conformance.task_checks.data.environment_ids", lambda: ids)


def results(task: StageTask, checks: list[Check], backend: str | None = None) -> list[Result]:
    bench = TaskBench(task, installed().backend(backend or venue_of(task).home))
    found = [run_check(check, bench) for check in checks]
    bench.close()
    return found


def failed(found: list[Result]) -> dict[str, str]:
    return {result.number: result.message for result in found if result.outcome == "fail"}


def test_there_is_a_broken_task_for_every_number() -> None:
    assert list(BROKEN) == NUMBERS == [f"T{i}" for i in range(1, len(TASK_CHECKS) + 1)]


@pytest.mark.parametrize("number", NUMBERS)
def test_a_broken_task_fails_exactly_its_check(number: str) -> None:
    """New processes, which take most of the time, are only started for the line that the task is wrong in."""
    found = failed(results(BROKEN[number], [c for c in TASK_CHECKS if c.number not in IN_NEW_PROCESSES - {number}]))
    assert list(found) == [number], found
    assert len(found[number]) > 30  # a sentence, not a bare name


@pytest.mark.parametrize(
    "left_out",
    [IN_NEW_PROCESSES, pytest.param(frozenset(), marks=pytest.mark.long)],
    ids=["in this process", "in new ones, too"],
)
@pytest.mark.parametrize("task", [HOVER, CAR], ids=["scenes", "environments"])
def test_the_examples_fail_nothing(task: StageTask, left_out: frozenset[str]) -> None:
    assert failed(results(task, [check for check in TASK_CHECKS if check.number not in left_out])) == {}


@pytest.mark.parametrize("name", ["pure_manipulation", "pure_manipulation_dense", "mobile_manipulation", "stack"])
def test_tasks_that_come_along_fail_nothing(name: str) -> None:
    checks = [check for check in TASK_CHECKS if check.number not in IN_NEW_PROCESSES]
    assert failed(results(installed().task(name), checks)) == {}


def test_the_documentation_lists_the_same_contract() -> None:
    text = (Path(__file__).parents[2] / "docs" / "task_conformance.md").read_text()
    lines = re.findall(r"^\*\*(T\d+)\.\*\* (.+)$", text, re.MULTILINE)
    assert lines == [(check.number, check.sentence) for check in TASK_CHECKS]


def test_names_carry_the_number() -> None:
    for check in TASK_CHECKS:
        assert check.test_name.startswith(f"test_t{int(check.number[1:]):02d}_")


def test_the_command_checks_a_task_and_prints_json(cli: Callable) -> None:
    done = cli("check", "--task", "pure_manipulation", "--json")
    content = json.loads(done.stdout)
    assert (done.returncode, content["task"], content["backend"]) == (0, "pure_manipulation", "kinematic")
    assert [row["number"] for row in content["checks"]] == NUMBERS + [check.number for check in TASK_WARNINGS]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "error: expected the name of a backend, or --task NAME"),
        (["kinematic", "--task", "pure_manipulation"], "error: expected the name of a backend, or --task NAME"),
        (["--task", "pure"], "error: unknown task 'pure'"),
        (["--task", "pure_manipulation", "--backend", "gymnasium"], "error: backend 'gymnasium' "),
    ],
)
def test_mistakes_exit_with_2(cli: Callable, arguments: list[str], message: str) -> None:
    done = cli("check", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)
