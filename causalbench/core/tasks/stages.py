"""Stage bookkeeping that every task shares: which terms are active, what a transition between stages means."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stage_task import Term
from causalbench.core.tasks.task import Task
from causalbench.core.world.facts import Facts

Array = NDArray[np.float64]


def active_terms(terms: tuple[Term, ...], n_stages: int) -> NDArray[np.bool_]:
    """Table (n_stages + 1, n_terms): row i says which terms belong to stage i; row 0 is unused."""
    table = np.zeros((n_stages + 1, len(terms)), dtype=bool)
    for column, term in enumerate(terms):
        table[list(term.stages), column] = True
    return table


class Transition(NamedTuple):
    """What one control step meant to the task; every field may carry batch dimensions."""

    vector_reward: Array  # (..., n_terms)
    next_stage: NDArray[np.int64]  # (...) 1-based
    reversal: NDArray[np.bool_]  # (...) U(s') < U(s) on a step that is not success
    success: NDArray[np.bool_]  # (...)


def judge(task: Task, stage: NDArray[np.int64], previous: Facts, action: Array, now: Facts) -> Transition:
    """Judge the step from `previous` (in `stage` = U(previous)) by `action` to `now`."""
    next_stage, success = task.stage(now), task.success(stage, now)
    vector = task.rewards(previous, stage, action, now, next_stage)
    return Transition(vector, next_stage, (next_stage < stage) & ~success, success)
