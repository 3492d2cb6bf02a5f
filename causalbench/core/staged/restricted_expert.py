"""Is a set of actions enough for a stage? The scripted expert with all others held at 0.

The paper's criterion for a causal action space, complete yet non-redundant: with it the stage can be solved, and
without any one of its actions less well.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.worlds import Worlds
from causalbench.core.world.capabilities import Capability

STARTS = 50


def solved_starts(
    worlds: Worlds, stage: int, actions: Mapping[int, Collection[str]], starts: int = STARTS
) -> NDArray[np.bool_]:
    """Bool (starts,): from which starts of `stage` the expert gets further with `actions` (stage -> names) alone.

    In stage i every action outside `actions[i]` is sent as 0; the expert has the map. Solved means a step into a later
    stage than `stage`, or success, within the task's horizon; a world that falls back continues with the actions of its
    new stage. Start i is the same whatever the actions, and the same seed in every simulator. `worlds` has a shape
    (n,). Raises `UserError` where there is no expert.
    """
    worlds.require(Capability.EXPERT, "solving a stage on some of its actions")
    task = worlds.task
    allowed = np.array([[a in actions.get(s, ()) for a in task.actions] for s in range(task.n_stages + 1)])
    solved = np.zeros(starts, dtype=bool)
    for first in range(0, starts, worlds.n):
        here = np.arange(min(worlds.n, starts - first))
        worlds.reset(here.tolist(), [np.random.default_rng([stage, first + int(i)]) for i in here], stage)
        running = np.isin(np.arange(worlds.n), here)
        for _ in range(task.horizon):
            chosen = np.zeros((worlds.n, len(task.actions)))
            permitted = allowed[worlds.stage[here]] & running[here, None]
            chosen[here] = np.where(permitted, worlds.expert(here.tolist()), 0.0)
            step = worlds.step(chosen)
            ahead = running & ((step.next_stage > stage) | step.success)
            solved[first + np.flatnonzero(ahead)] = True
            running &= ~(ahead | step.terminated)
            if not running.any():
                break
    return solved
