"""One Gymnasium environment as a staged world: what was last seen of it, and what a step meant to the task."""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.gym_task import GymTask, Seen
from causalbench.core.tasks.stages import active_terms
from causalbench.errors import UserError

Array = NDArray[np.float64]
Env = gym.Env[Any, Any]


class WorldStep(NamedTuple):
    """The fields of `worlds.Step` for one world."""

    stage: int
    next_stage: int
    rewards: Array
    success: bool
    reversal: bool
    terminated: bool


class GymWorld:
    """One environment: `seen` is what it last gave, `stage` U(s) then, 0 before the first reset.

    An environment that ended by itself (`over`) stands still, and its steps pay nothing, until it is reset or restored.
    Raises `UserError` for an action space that does not fit the task.
    """

    def __init__(self, task: GymTask, env: Env) -> None:
        self.task, self.env = task, _without_clocks(env)
        self.force = _force(task, self.env)  # (n_actions,) what actions of 1 are in the environment
        self.seen, self.stage, self.over = Seen(None, {}), 0, True
        self._active = active_terms(task.terms, task.n_stages)

    def reset(self, rng: np.random.Generator) -> None:
        """A start of the environment's own, seeded from `rng`."""
        self._see(Seen(*self.env.reset(seed=int(rng.integers(2**31)))))

    def reset_into(self, rng: np.random.Generator, stage: int) -> None:
        """A start that the task means to lie inside `stage`."""
        assert self.task.reset_into is not None
        self._prepare()
        self._see(self.task.reset_into(self.env, rng, stage))

    def snapshot(self) -> bytes:
        """All of its state."""
        assert self.task.snapshot is not None
        return self.task.snapshot(self.env)

    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot."""
        assert self.task.restore is not None
        self._prepare()
        self._see(self.task.restore(self.env, snapshot))

    def _prepare(self) -> None:
        """Gymnasium's wrappers want a reset before anything else."""
        if not self.stage:
            self.env.reset(seed=0)

    def _see(self, seen: Seen, over: bool = False) -> None:
        """Go on from what is seen now, a copy: some environments change the arrays that they gave."""
        stage = int(self.task.stage(seen))
        if not 1 <= stage <= self.task.n_stages:
            raise UserError(f"task {self.task.name!r}: stage() said {stage}, expected 1 to {self.task.n_stages}")
        self.stage, self.over = stage, over
        self.seen = Seen(copy.deepcopy(seen.observation), seen.info)

    def step(self, action: Array, repeat: int) -> WorldStep:
        """Hold `action` (n_actions,) for `repeat` steps, or until the environment ends, and judge what came of it."""
        task, before, stage = self.task, self.seen, self.stage
        if self.over:
            return WorldStep(stage, stage, np.zeros(len(task.terms)), False, False, True)
        now, over = self._hold(action, repeat)
        self._see(now, over)
        success = bool(task.success(stage, now))
        paid = self._checked("rewards", task.rewards(before, stage, action, now, self.stage), len(task.terms))
        rewards = np.where(self._active[stage], paid, 0.0)
        return WorldStep(stage, self.stage, rewards, success, self.stage < stage and not success, success or over)

    def _hold(self, action: Array, repeat: int) -> tuple[Seen, bool]:
        """What is seen at the end, with the sum of the rewards, and whether the environment ended."""
        force = (np.clip(action, -1.0, 1.0) * self.force).astype(self.env.action_space.dtype)
        paid = 0.0
        for _ in range(repeat):
            observation, reward, terminated, truncated, info = self.env.step(force.copy())
            paid += float(reward)
            if over := bool(terminated or truncated):
                break
        return Seen(observation, info, paid), over

    def observed(self) -> Array:
        """(n_state,) the state variables."""
        return self._checked("observe", self.task.observe(self.seen), len(self.task.state_names))

    def expert(self) -> Array:
        """(n_actions,) the expert's action."""
        assert self.task.expert is not None
        return np.clip(self._checked("expert", self.task.expert(self.seen), len(self.task.actions)), -1.0, 1.0)

    def _checked(self, function: str, values: Any, length: int) -> Array:
        """What a function of the task said, as float64 (length,). Raises `UserError`."""
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (length,):
            raise UserError(f"task {self.task.name!r}: {function}() said {values!r}, expected shape ({length},)")
        return array


def _without_clocks(env: Env) -> Env:
    """`env` without its time limits, also those below other wrappers."""
    while isinstance(env, gym.wrappers.TimeLimit):
        env = env.env
    if isinstance(env, gym.Wrapper):
        env.env = _without_clocks(env.env)
    return env


def _force(task: GymTask, env: Env) -> Array:
    space, shape = env.action_space, (len(task.actions),)
    if isinstance(space, gym.spaces.Box) and space.shape == shape and _is_about_0(space):
        return space.high.astype(np.float64)
    raise UserError(
        f"task {task.name!r}: the environment's action space is {space}, expected a finite Box of shape {shape}, each "
        "dimension from -x to x, since 0 means that an action is not executed; gymnasium.ActionWrapper can make it so"
    )


def _is_about_0(space: gym.spaces.Box) -> bool:
    return bool(np.isfinite(space.high).all() and (space.high > 0).all() and (space.low == -space.high).all())
