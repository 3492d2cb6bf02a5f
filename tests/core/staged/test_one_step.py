"""Only staged worlds judge: nothing else asks a task what an action was worth or whether it succeeded."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
JUDGES = {
    "causalbench/core/staged/scene_worlds.py",
    "causalbench/core/staged/gym_world.py",
    "causalbench/core/staged/lagged_worlds.py",
    "causalbench/core/tasks/changes/scenes.py",
    "causalbench/core/tasks/pure_manipulation_dense.py",
    "causalbench/conformance/task_checks/repeat.py",
    "causalbench/conformance/task_checks/rewards.py",
    "causalbench/conformance/task_checks/success.py",
}
"""Where `Worlds._step` is implemented, a task that is another one with a further term, and what checks the functions.

A task's own module calls its own functions, never those of a `task`.
"""
VERDICTS, TASKS = {"rewards", "success"}, ("task", "TASK", "Task")
MODULES = [
    *(ROOT / "causalbench").rglob("*.py"),
    *ROOT.glob("plugins/*/causalbench_*/**/*.py"),
    *ROOT.glob("examples/**/*.py"),
    *ROOT.glob("studies/**/*.py"),
    *ROOT.glob("benchmarks/**/*.py"),
]


def verdicts(source: str) -> list[str]:
    """The places, `line: expression`, that ask for a task's verdict: a call of it, or `...task.rewards` uncalled."""
    return [f"{node.lineno}: {ast.unparse(node)}" for node in ast.walk(ast.parse(source)) if asks(node)]


def asks(node: ast.AST) -> bool:
    """Whether this is such a place."""
    if isinstance(node, ast.ImportFrom):
        return "judge" in {alias.name for alias in node.names}
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Attribute) and node.func.attr in VERDICTS
    return isinstance(node, ast.Attribute) and node.attr in VERDICTS and ast.unparse(node.value).endswith(TASKS)


@pytest.mark.parametrize(
    "line",
    [
        "task.rewards(a, b)",
        "self.task.success(s, f)",
        "f = env.task.rewards",
        "t.success(s, f)",
        "from x.scene_worlds import judge",
    ],
)
def test_a_verdict_is_found(line: str) -> None:
    assert verdicts(line)


@pytest.mark.parametrize("line", ["step.rewards", "samples.rewards.std()", "step.success.any()", "judge(networks)"])
def test_what_a_step_says_is_none(line: str) -> None:
    assert verdicts(line) == []


def test_only_staged_worlds_ask_a_task_for_its_verdict() -> None:
    found = {str(path.relative_to(ROOT)): verdicts(path.read_text(encoding="utf-8")) for path in MODULES}
    assert {path: places for path, places in found.items() if places and path not in JUDGES} == {}
