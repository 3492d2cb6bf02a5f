"""Is a set of actions enough for a stage? The scripted expert with all others held at 0.

The paper's criterion for a causal action space, complete yet non-redundant: with it the stage can be solved, and
without any one of its actions less well.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.env import action_columns, reset_worlds
from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene, select

STARTS = 50


def solved_starts(
    task: Task, batch: BatchScene, stage: int, actions: Mapping[int, Collection[str]], starts: int = STARTS
) -> NDArray[np.bool_]:
    """Bool (starts,): from which starts of `stage` the expert gets further with `actions` (stage -> names) alone.

    In stage i every action outside `actions[i]` is sent as 0; the expert has the map. Solved means a step into a later
    stage than `stage`, or success, within `task.horizon` steps; who is thrown back goes on with the actions of the
    stage he is in.
    Start i is the same whatever the actions, and the same seed in every simulator.
    """
    allowed = np.array([[a in actions.get(s, ()) for a in task.actions] for s in range(task.n_stages + 1)])
    columns = action_columns(task, batch.spec)
    solved = np.zeros(starts, dtype=bool)
    for first in range(0, starts, batch.n):
        here = np.arange(min(batch.n, starts - first))
        rngs = [np.random.default_rng([stage, first + int(i)]) for i in here]
        layouts = reset_worlds(task, batch, here.tolist(), rngs, stage)
        running = np.isin(np.arange(batch.n), here)
        before = batch.facts()
        inside = task.stage(before)
        for _ in range(task.horizon):
            chosen = np.zeros((batch.n, len(task.actions)))
            wanted = task.expert(select(before, here), batch.spec, layouts)
            chosen[here] = np.where(allowed[inside[here]] & running[here, None], wanted, 0.0)
            full = np.zeros((batch.n, len(batch.spec.actions)))
            full[:, columns] = chosen
            batch.step(full)
            now = batch.facts()
            result = judge(task, inside, before, chosen, now)
            ahead = running & ((result.next_stage > stage) | result.success)
            solved[first + np.flatnonzero(ahead)] = True
            running &= ~ahead
            if not running.any():
                break
            before, inside = now, result.next_stage
    return solved
