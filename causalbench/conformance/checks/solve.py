"""The task can be done."""

from __future__ import annotations

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import start
from causalbench.core.tasks.lift_and_hold import lift_and_hold
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.scene import Scene


def _solve(scene: Scene) -> str:
    """Let the scripted expert act; "" for success, else where it ended."""
    columns = [scene.spec.actions.index(name) for name in TASK.actions]
    facts, action = scene.facts(), np.zeros(len(scene.spec.actions))
    for _ in range(TASK.horizon):
        before = TASK.stage(facts)
        action[columns] = TASK.expert(facts, scene.spec)
        scene.step(action)
        facts = scene.facts()
        if TASK.success(before, facts):
            return ""
    offset = facts.eef_position - facts.object_position
    stage = int(TASK.stage(facts))
    return f"after {TASK.horizon} steps it is in stage {stage}, the hand {np.round(offset, 3)} m off the box"


def s38_expert(bench: Bench) -> None:
    """S38. The scripted expert grasps the box from 10 starts of stage 1."""
    for seed in range(10):
        start(bench.scene, seed)
        where = _solve(bench.scene)
        expect(not where, f"the scripted expert does not grasp the box (seed {seed}): {where}")


def s39_lift(bench: Bench) -> None:
    """S39. What the expert has grasped can be lifted and held for 2 s, grip being 0 (5 starts of stage 3)."""
    for seed in range(5):
        start(bench.scene, seed, 3)
        where = _solve(bench.scene)
        expect(not where, f"the scripted expert does not grasp the box from above it (seed {seed}): {where}")
        expect(lift_and_hold(bench.scene), f"the grasped box was not lifted or was lost within 2 s (seed {seed})")
