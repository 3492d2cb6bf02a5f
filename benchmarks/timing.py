"""What the speed benchmarks share."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.scene import Scene

Array = NDArray[np.float64]

STEPS = 300  # control steps per comparison
EPISODE = 50  # control steps between resets


def timed(work: Callable[[], object]) -> float:
    """Seconds that one call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def seconds_per_update(rivals: Mapping[str, Callable[[], object]], updates: int, turns: int) -> dict[str, float]:
    """Median seconds of an update of each rival; they take turns, and one call does `updates` of them.

    Processor time of this thread, which is the one that computes: other work on the machine counts little.
    """
    seconds: dict[str, list[float]] = {name: [] for name in rivals}
    for _ in range(turns):
        for name, train in rivals.items():
            start = time.thread_time()
            train()
            seconds[name].append((time.thread_time() - start) / updates)
    return {name: statistics.median(values) for name, values in seconds.items()}


def random_actions(seed: int, count: int) -> Array:
    """Random walk actions (count, 7): each is held for five steps, so that the arm really travels."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, (count // 5 + 1, len(TASK.actions))), 5, axis=0)[:count]


def env_overhead(scene: Scene) -> str:
    """A line on what `StageTaskEnv.step` costs beside the scene's step + facts, from the same states and actions.

    The scene's figure is a median; the environment's adds the median of what it took longer, pair by pair, since steps
    differ among themselves by far more than that. Both come after a step, as in a run, not after a restore.
    """
    env = StageTaskEnv(SceneWorlds(TASK, scene))
    bare, extra = [], []
    for i, action in enumerate(random_actions(1, STEPS)):
        if i % EPISODE == 0:
            env.reset(seed=i)
        before, taken = scene.snapshot(), {}
        rivals = {"env": lambda a=action: env.step(a), "bare": lambda a=action: (scene.step(a), scene.facts())}
        for rival in ("env", "bare") if i % 2 else ("bare", "env"):
            scene.restore(before)
            scene.step(action)
            taken[rival] = timed(rivals[rival])
        bare.append(taken["bare"])
        extra.append(taken["env"] - taken["bare"])
    us, more = statistics.median(bare) * 1e6, statistics.median(extra) * 1e6
    return f"  StageTaskEnv {us + more:6.0f} us, scene {us:6.0f} us: {more / us:+.1%}"
