"""What a task says about itself, and how others come by it."""

from __future__ import annotations

import json
import sys

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import expect, in_new_process
from causalbench.conformance.task_bench import Sample, TaskBench
from causalbench.conformance.task_checks.repeat import difference, repeatable, rows
from causalbench.core.staged.worlds import MakeWorlds
from causalbench.core.tasks.task_data import task_data
from causalbench.plugins.environment_ids import environment_ids
from causalbench.suite.task_identity import task_identity


def t01_identity(bench: TaskBench) -> None:
    """T1. All data of the task is JSON, its constants included, and its identity is the same whenever it is computed.

    The identity is that of `causalbench.suite.task_identity`, which makes the ids of a run's cells.
    """
    try:
        json.dumps(task_data(bench.task))
    except TypeError as error:
        raise AssertionError(
            f"the task's data is not JSON ({error}): constants are numbers, texts and lists"
        ) from error
    first, second = (task_identity(bench.task).plain for _ in range(2))
    expect(first == second, "the identity of the task changed between two calls: do its functions remember anything?")


def t02_new_process(bench: TaskBench) -> None:
    """T2. The task can be pickled, and in a new process the same starts and actions give the same results.

    To six decimals: stages, rewards and states along a walk from a start of the first stage that can be entered.
    """
    if not bench.starts or not repeatable(bench):
        return
    stage = min(bench.starts)
    here = rows(bench, bench.walk(stage, 0))
    there = in_new_process(_walked, bench.task, bench.make_worlds, stage)
    expect(
        np.array_equal(here, there, equal_nan=True), f"in a new process a walk goes otherwise {difference(here, there)}"
    )


def _walked(task: object, make_worlds: MakeWorlds, stage: int) -> NDArray[np.float64]:
    bench = object.__new__(TaskBench)
    bench.task, bench.make_worlds, bench._made = task, make_worlds, []
    try:
        found: list[Sample] = bench.walk(stage, 0)
        return rows(bench, found)
    finally:
        bench.close()


def t03_imports(bench: TaskBench) -> None:
    """T3. Importing the task imports no simulator, none of `GymTask.modules`."""
    found = in_new_process(_imported, bench.make_worlds, bench.task.modules)
    expect(not found, f"importing the task's module imports {', '.join(found)}: import them inside its functions")


def _imported(make_worlds: MakeWorlds, modules: tuple[str, ...]) -> list[str]:
    """Which of `modules` are imported, `make_worlds` having been unpickled and so the task's module imported."""
    return [name for name in modules if name in sys.modules]


def t04_environment_id(bench: TaskBench) -> None:
    """T4. Gymnasium finds the task by its `env_id`, once `causalbench` is imported.

    An entry point in the group "causalbench.environments" says so: id = name of the task.
    """
    task, ids = bench.task, environment_ids()
    expect(
        ids.get(task.env_id) == task.name,
        f"env_id {task.env_id!r} is that of {ids.get(task.env_id, 'no task')!r}, expected {task.name!r}: declare the "
        f'entry point "{task.env_id}" = "{task.name}" in the group "causalbench.environments"',
    )


def t05_discoverable(bench: TaskBench) -> None:
    """T5. Every stage has a term that discovery may use."""
    without = [stage for stage in bench.stages if not bench.task.stage_terms(stage, discoverable_only=True)]
    expect(not without, f"stages {without} have no term with discoverable=True: nothing there has causes to be found")
