"""Staged tasks over Gymnasium environments, for tests: the example's mountain car, and a line that one can fall off."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from causalbench.core.staged.gym_worlds import GymWorlds, make_gym_worlds
from causalbench.core.tasks.gym_task import GymTask, Seen
from causalbench.core.tasks.stage_task import Term

CAR_FILE = Path(__file__).parents[1] / "examples" / "a_gym_task" / "causalbench_mountain_car.py"


def _module(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


CAR: GymTask = _module(CAR_FILE).TASK
CAR_THAT_FORGETS = dataclasses.replace(CAR, snapshot=None, restore=None, exact_restore=False)
"""The same without what a world needs to be restored."""


class Line(gym.Env[dict[str, Any], Any]):
    """x moves by the first of two actions, the second is what a step pays; it ends by itself where x < -1.

    It observes a Dict whose array it changes in place.
    """

    observation_space = gym.spaces.Dict({"x": gym.spaces.Box(-np.inf, np.inf, (1,), np.float64)})
    action_space = gym.spaces.Box(-2.0, 2.0, (2,), np.float32)
    render_mode = None

    def __init__(self, start: float = 0.0) -> None:
        self.start, self.x, self.steps, self.closed = start, np.zeros(1), 0, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.x[0] = self.start + self.np_random.uniform(-0.1, 0.1)
        return {"x": self.x}, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        self.x[0] += action[0]
        return {"x": self.x}, float(action[1]), bool(self.x[0] < -1), False, {}

    def close(self) -> None:
        self.closed += 1


def put(env: gym.Env[Any, Any], rng: np.random.Generator, stage: int) -> Seen:
    env.unwrapped.x[0] = rng.uniform(0, 6)
    return Seen({"x": env.unwrapped.x}, {})


LINE = GymTask(
    name="line",
    version=0,
    env_id="line/Line-v0",
    n_stages=2,
    actions=("move", "pay"),
    terms=(
        Term("r_near", (1,), True, "way to the right"),
        Term("r_paid", (1, 2), True, "what the environment paid"),
        Term("r_far", (2,), True, "as r_near"),
    ),
    state_names=("x",),
    horizon=20,
    constants={},
    manual_graph={1: {"r_near": frozenset({"move"})}},
    environments={"gymnasium": Line},
    stage=lambda seen: 2 if seen.observation["x"][0] >= 3 else 1,
    success=lambda stage, now: stage == 2 and now.observation["x"][0] >= 6,
    rewards=lambda before, stage, action, now, next_stage: np.array([
        now.observation["x"][0] - before.observation["x"][0], now.reward, now.observation["x"][0]
    ]),
    observe=lambda seen: seen.observation["x"],
    state_bounds=(np.array([-1.0]), np.array([7.0])),
)  # fmt: skip


def maker(task: GymTask, **options: Any) -> Callable[..., GymWorlds]:
    """A `MakeWorlds` of `task`."""
    return partial(make_gym_worlds, task, "gymnasium", options)
