"""The contract of a task: the table of checks of its worlds, scenes or Gymnasium environments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from causalbench.conformance.check import WARNING, Check, Result, run_check
from causalbench.conformance.task_bench import TaskBench
from causalbench.conformance.task_checks import data, observed, repeat, rewards, stages, success, warnings
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability
from causalbench.plugins.backends import NO_OPTIONS, Backend

TASK_CHECKS = (
    Check(data.t01_identity),
    Check(data.t02_new_process),
    Check(data.t03_imports, ("modules",)),
    Check(data.t04_environment_id, ("env_id",)),
    Check(data.t05_discoverable),
    Check(stages.t06_total),
    Check(stages.t07_memoryless),
    Check(stages.t08_entered),
    Check(stages.t09_starts_differ),
    Check(repeat.t10_deterministic),
    Check(repeat.t11_together),
    Check(repeat.t12_restored, (Capability.RESTORE,)),
    Check(repeat.t13_pure),
    Check(rewards.t14_inactive),
    Check(rewards.t15_sum),
    Check(rewards.t16_of_the_step),
    Check(rewards.t17_vary),
    Check(rewards.t18_antisymmetric, ("potential",)),
    Check(observed.t19_state),
    Check(observed.t20_bounds),
    Check(observed.t21_features, ("features",)),
    Check(observed.t22_potential, ("potential",)),
    Check(success.t23_not_yet),
    Check(success.t24_expert, (Capability.EXPERT,)),
    Check(success.t25_solved, (Capability.EXPERT,)),
    Check(success.t26_stands, (Capability.EXPERT, "after_success")),
)
"""The contract, in the order of its numbers."""

EXPERT, RESTORE = Capability.EXPERT, Capability.RESTORE
TASK_WARNINGS = tuple(
    Check(function, needs, WARNING)
    for function, needs in (
        (warnings.w01_left_at_once, (EXPERT,)),
        (warnings.w02_causes, (RESTORE,)),
        (warnings.w03_enough, (EXPERT, RESTORE)),
        (warnings.w04_no_farming, (EXPERT,)),
        (warnings.w05_reached, (EXPERT,)),
        (warnings.w06_vary_at_random, (RESTORE,)),
        (warnings.w07_forward, (EXPERT,)),
    )
)
"""What a task that keeps the contract may be decomposed badly in."""


def run_task_checks(task: StageTask, backend: Backend, options: Mapping[str, Any] = NO_OPTIONS) -> Iterator[Result]:
    """Run the whole contract of `task` in `backend`, and then what may be warned of, one result after the other.

    Raises `UserError` where the backend cannot run the task.
    """
    bench = TaskBench(task, backend, options)
    try:
        for check in (*TASK_CHECKS, *TASK_WARNINGS):
            yield run_check(check, bench)
    finally:
        bench.close()
