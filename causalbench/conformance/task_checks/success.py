"""Success, and the expert that comes to it."""

from __future__ import annotations

import functools

import numpy as np

from causalbench.conformance.bench import expect
from causalbench.conformance.task_bench import TaskBench, expert
from causalbench.conformance.task_checks.repeat import scripted

EPISODES, NEEDED = 5, 4


def t23_not_yet(bench: TaskBench) -> None:
    """T23. No start is a success already."""
    for stage, starts in bench.starts.items():
        done = sum(bool(bench.task.success(np.int64(stage), start)) for start in starts)
        expect(not done, f"{done} of {len(starts)} starts of stage {stage} are a success before the first step")


def t24_expert(bench: TaskBench) -> None:
    """T24. The expert gives one number in [-1, 1] for each action."""
    for sample in bench.samples:
        action = np.asarray(scripted(bench, sample.now))
        expect(action.shape == (len(bench.task.actions),), f"the expert's action has the shape {action.shape}")
        expect(bool((np.abs(action) <= 1.0).all()), f"the expert's action is {action}, expected numbers in [-1, 1]")


def t25_solved(bench: TaskBench) -> None:
    """T25. The expert reaches success within the horizon from at least 4 of 5 starts."""
    ends = [where for where, _ in _episodes(bench)]
    failed = [where for where in ends if where]
    expect(len(failed) <= EPISODES - NEEDED, f"the expert succeeds from {EPISODES - len(failed)} of 5 starts: {failed}")


def t26_stands(bench: TaskBench) -> None:
    """T26. The expert's successes pass the task's own test, `after_success`, in at least 4 of 5 cases."""
    stood = [test for where, test in _episodes(bench) if not where]
    fell = stood.count(False)
    expect(fell <= EPISODES - NEEDED, f"{fell} of {len(stood)} successes of the expert do not stand after_success")


@functools.lru_cache(maxsize=1)
def _episodes(bench: TaskBench) -> list[tuple[str, bool | None]]:
    """Where each episode of the expert ended, "" for success, and what `after_success` said of that."""
    worlds, found = bench.worlds, []
    for seed in range(EPISODES):
        worlds.reset([0], [np.random.default_rng(seed)])
        where, stood = "", None
        for _ in range(bench.task.horizon):
            step = worlds.step(expert(worlds))
            if step.terminated:
                break
        if bool(step.success):
            stood = worlds.after_success(0)
        else:
            where = f"seed {seed} ended in stage {int(step.next_stage)}"
        found.append((where, stood))
    return found
