"""The task can be done."""

from __future__ import annotations

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK


def _solve(worlds: SceneWorlds, seed: int, stage: int) -> str:
    """Let the scripted expert act from a start of `stage`; "" for success, else where it ended."""
    worlds.reset([0], [np.random.default_rng(seed)], stage)
    for _ in range(TASK.horizon):
        if worlds.step(worlds.expert()).success:
            return ""
    offset = np.round(worlds.facts.eef_position - worlds.facts.object_position, 3)
    return f"after {TASK.horizon} steps it is in stage {worlds.stage}, the hand {offset} m off the box"


def s38_expert(bench: Bench) -> None:
    """S38. The scripted expert grasps the box from 10 starts of stage 1."""
    worlds = SceneWorlds(TASK, bench.scene)
    for seed in range(10):
        where = _solve(worlds, seed, 1)
        expect(not where, f"the scripted expert does not grasp the box (seed {seed}): {where}")


def s39_lift(bench: Bench) -> None:
    """S39. The box that the expert has grasped can be lifted and held for 2 s with grip at 0 (5 starts of stage 3)."""
    worlds = SceneWorlds(TASK, bench.scene)
    for seed in range(5):
        where = _solve(worlds, seed, 3)
        expect(not where, f"the scripted expert does not grasp the box from above it (seed {seed}): {where}")
        expect(worlds.after_success(0), f"the grasped box was not lifted or was lost within 2 s (seed {seed})")
