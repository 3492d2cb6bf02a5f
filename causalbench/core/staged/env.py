"""Gymnasium environment of one staged world: the scalar through `step`, the vector in `info["vector_reward"]`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.observation import Observation, Observe
from causalbench.core.staged.reset_request import STAGE, checked_options, checked_seed, checked_stage
from causalbench.core.staged.worlds import MakeWorlds, Worlds
from causalbench.core.world.capabilities import Capability
from causalbench.errors import UserError

WIDTH, HEIGHT = 480, 360  # pixels of what `render` returns


class StageTaskEnv(gym.Env[Observation, NDArray[np.float32]]):
    """A staged task in one world; `worlds` has the shape ().

    Observation: see `observation.Observer`.
    Action: (n_actions,) float32 in [-1, 1], names in `action_names`; 0 means "not executed".
    Reward: the sum of the active terms. Reward vector: `info["vector_reward"]`, float64 (n_terms,), named
    `reward_names`, space `reward_space` (the MO-Gymnasium convention).
    `info` also has `stage` and `next_stage` (from 1, as in the paper), `reversal`, `is_success`.
    `terminated` is the task's verdict, or the end of a world that cannot go on; `truncated` the clock (`task.horizon`
    control steps).
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium declares it as an instance variable

    make_worlds: MakeWorlds | None = None
    """Makes other worlds like this one; `make_env` sets it, and `causalbench.train` needs it."""

    def __init__(
        self,
        worlds: Worlds,
        render_mode: str | None = None,
        observe_gripper: bool = True,
        observe: Observe = "state",
        features: bool = True,
    ) -> None:
        if worlds.shape:
            raise UserError(f"StageTaskEnv takes one world of shape (), got worlds of shape {worlds.shape}")
        if render_mode is not None:
            if render_mode not in self.metadata["render_modes"]:
                raise UserError(f"render_mode {render_mode!r}: expected None or 'rgb_array'")
            worlds.require(Capability.RGB, f"render_mode {render_mode!r}")
        self.worlds, self.task, self.render_mode = worlds, worlds.task, render_mode
        self.observe_gripper, self.observe, self.features = observe_gripper, observe, features
        worlds.choose_observation(observe_gripper, observe, features)
        self.metadata = self.metadata | {"render_fps": worlds.render_fps}
        self.action_names, self.reward_names = self.task.actions, self.task.term_names
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(self.action_names),), np.float32)
        self.reward_space = gym.spaces.Box(-np.inf, np.inf, (len(self.reward_names),), np.float64)
        self.observation_space = worlds.observation_space
        self._clock: int | None = None  # control steps of this episode; None before the first

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new start, drawn from `self.np_random`; `options={"stage": i}` starts inside stage i.

        Raises `UserError` for a seed that is no whole number from 0 and for other options.
        """
        stage = checked_stage(checked_options(options, (STAGE,)), self.task)
        super().reset(seed=checked_seed(seed))
        self.worlds.reset([0], [self.np_random], stage)
        self._clock = 0
        return self.worlds.observe(), {"stage": int(self.worlds.stage)}

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control step; see the class for what comes back. Raises `InvalidActionError`."""
        if self._clock is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        step = self.worlds.step(action)
        self._clock += 1
        info = {
            "vector_reward": step.rewards,
            "stage": int(step.stage),
            "next_stage": int(step.next_stage),
            "reversal": bool(step.reversal),
            "is_success": bool(step.success),
        }
        terminated = bool(step.terminated)
        truncated = self._clock >= self.task.horizon and not terminated
        return self.worlds.observe(), float(np.add.reduce(step.rewards)), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the task's camera when `render_mode` is "rgb_array"."""
        return self.worlds.render(WIDTH, HEIGHT) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the world; may be called twice."""
        self.worlds.close()


class VectorReward(
    gym.Wrapper[Observation, NDArray[np.float32], Observation, NDArray[np.float32]], gym.utils.RecordConstructorArgs
):
    """A wrapper whose `step` returns the reward vector, as MO-Gymnasium's wrappers and morl-baselines expect it.

    The vector is float32 (n_terms,), with the names `reward_names`. `reward_space` is its space.
    `gymnasium.make(wrapped.spec)` makes the wrapped environment again.
    """

    def __init__(self, env: gym.Env[Observation, NDArray[np.float32]]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        names = env.get_wrapper_attr("reward_names")
        self.reward_space = gym.spaces.Box(-np.inf, np.inf, (len(names),), np.float32)

    def step(self, action: NDArray[Any]) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """As `StageTaskEnv.step`, the reward being float32 (n_terms,)."""
        obs, _, terminated, truncated, info = self.env.step(action)
        return obs, info["vector_reward"].astype(np.float32), terminated, truncated, info
