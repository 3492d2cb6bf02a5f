"""Is a set of actions enough for a stage? The scripted expert with every other action held at 0.

The paper's criterion for a causal action space, complete yet non-redundant: with it the stage can be solved, and
without any one of its actions less well.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from causalbench.core.batch import BatchScene
from causalbench.core.env import action_columns, reset_worlds
from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task

STARTS = 50


def solved_starts(
    task: Task, batch: BatchScene, stage: int, actions: Collection[str], starts: int = STARTS
) -> NDArray[np.bool_]:
    """Bool (starts,): which starts of `stage` the expert solves with `actions` alone, the others sent as 0.

    Solved means a step into a later stage, or success, within `task.horizon` steps; a step back ends the attempt.
    Start i is the same whatever the actions, and the same seed in every simulator.
    """
    allowed = np.array([action in actions for action in task.actions])
    columns = action_columns(task, batch.spec)
    solved = np.zeros(starts, dtype=bool)
    for first in range(0, starts, batch.n):
        here = np.arange(min(batch.n, starts - first))
        rngs = [np.random.default_rng([stage, first + int(i)]) for i in here]
        reset_worlds(task, batch, here.tolist(), rngs, stage)
        running, inside = np.isin(np.arange(batch.n), here), np.full(batch.n, stage)
        before = batch.facts()
        for _ in range(task.horizon):
            chosen = np.where(allowed & running[:, None], task.expert(before, batch.spec), 0.0)
            full = np.zeros((batch.n, len(batch.spec.actions)))
            full[:, columns] = chosen
            batch.step(full)
            now = batch.facts()
            result = judge(task, inside, before, chosen, now)
            forward = (result.next_stage > stage) | result.success
            solved[first + np.flatnonzero(running & forward)] = True
            running &= (result.next_stage == stage) & ~result.success
            if not running.any():
                break
            before = now
    return solved
