"""What a task does, as numbers: a fixed scripted and random sequence through each of its stages on kinematic worlds.

Constants and names do not say what a task's functions make of them. The trace does: every reward, stage, success, state
variable and feature of the sequence, rounded to `DECIMALS`, so that another processor's last bits make no other task.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic import make
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.core.tasks.task import Task

DECIMALS = 6
SCRIPTED, RANDOM = 25, 15  # control steps in each stage


def task_trace(task: Task) -> NDArray[np.float64]:
    """The rounded numbers (n_stages * (`SCRIPTED` + `RANDOM`), n_terms + 2 + n_state + n_features).

    Each row is a control step: rewards, next stage, success, the state and its features. A start of every stage is
    followed by the expert and then by random actions. Raises what the task or the kinematic scene raises if it cannot
    run there.
    """
    worlds = make_scene_worlds(task, lambda: make(**task.scene_options))
    rows = []
    try:
        for stage in range(1, task.n_stages + 1):
            rng = np.random.default_rng(stage)
            worlds.reset([0], [rng], stage)
            for step in range(SCRIPTED + RANDOM):
                wanted = worlds.expert() if step < SCRIPTED else rng.uniform(-1.0, 1.0, len(task.actions))
                done = worlds.step(wanted)
                state = task.observe(worlds.facts)
                rows.append([*done.rewards, done.next_stage, done.success, *state, *task.features_of(state)])
    finally:
        worlds.close()
    return np.round(np.array(rows, dtype=np.float64), DECIMALS) + 0.0  # no negative zeros


def trace_hash(task: Task) -> str:
    """The first 16 hex digits of the SHA-256 of `task_trace`."""
    return hashlib.sha256(np.ascontiguousarray(task_trace(task), "<f8").tobytes()).hexdigest()[:16]
