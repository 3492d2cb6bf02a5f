"""What a 64 x 48 picture costs on every backend: python benchmarks/rgb_speed.py (seconds, one core).

Processor time of one process, all its threads together, in motion. Needs an otherwise idle core.
"""

from __future__ import annotations

import statistics
import time

from timing import random_actions

from causalbench.core.world.cameras import HEIGHT, WIDTH
from causalbench.registration import make_env

GOALS = {"gymrob": 100, "pybullet": 200, "robosuite": 0, "kinematic": 0}  # pictures a second and core
PICTURES = 200


def seconds_per_picture(backend: str) -> tuple[float, float]:
    """Median processor time of a picture, and the time that passes until the first one is there."""
    env = make_env(backend=backend)
    env.reset(seed=0)
    started = time.perf_counter()
    env.worlds.scene.render(WIDTH, HEIGHT)
    first = time.perf_counter() - started
    seconds = []
    for action in random_actions(0, PICTURES):
        env.step(action)
        started = time.process_time()
        env.worlds.scene.render(WIDTH, HEIGHT)
        seconds.append(time.process_time() - started)
    env.close()
    return statistics.median(seconds), first


if __name__ == "__main__":
    for backend, goal in GOALS.items():
        each, first = seconds_per_picture(backend)
        wanted = f" (goal {goal})" if goal else ""
        print(f"{backend:9}  {1 / each:5.0f} pictures/s per core{wanted}, {each * 1e3:.2f} ms; the first {first:.2f} s")
