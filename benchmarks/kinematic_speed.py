"""What the kinematic backend and `StageTaskEnv` cost: python benchmarks/kinematic_speed.py (about 20 s, one core).

Rivals take turns (A B A B ...); figures are medians of turns. Needs an otherwise idle core.
"""

from __future__ import annotations

import statistics

import numpy as np
from timing import timed

from causalbench.core.kinematic import make
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.staged.starts import draw_starts
from causalbench.core.tasks.pure_manipulation import TASK

TURNS, STEPS, WORLDS = 15, 400, 256


def single() -> tuple[float, float]:
    """Median seconds per control step of the bare scene (step + facts) and of `StageTaskEnv`."""
    env = StageTaskEnv(SceneWorlds(TASK, make()))
    actions = np.random.default_rng(0).uniform(-0.1, 0.1, (STEPS, len(TASK.actions)))

    def bare() -> None:
        for action in actions:
            env.worlds.scene.step(action)
            env.worlds.scene.facts()

    def whole() -> None:
        for action in actions:
            env.step(action)

    turns = []
    for seed in range(TURNS):
        env.reset(seed=seed)
        turns.append((timed(bare), timed(whole)))
    bare_time, whole_time = (statistics.median(column) / STEPS for column in zip(*turns, strict=True))
    return bare_time, whole_time


def batched() -> float:
    """Median seconds per world step of a batch (step + facts)."""
    batch = make().batch(WORLDS)
    rng = np.random.default_rng(0)
    draw_starts(TASK, batch, range(WORLDS), [rng] * WORLDS)
    actions = rng.uniform(-0.1, 0.1, (WORLDS, len(TASK.actions)))

    def steps() -> None:
        for _ in range(50):
            batch.step(actions)
            batch.facts()

    return statistics.median(timed(steps) for _ in range(TURNS)) / (50 * WORLDS)


def main() -> None:
    """Print all comparisons."""
    bare, whole = single()
    print(f"single scene: {1 / bare:,.0f} steps/s; StageTaskEnv adds {1e6 * (whole - bare):.0f} us a step")
    print(f"batch of {WORLDS}: {1 / batched():,.0f} steps/s")


if __name__ == "__main__":
    main()
