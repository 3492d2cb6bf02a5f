"""gymnasium-robotics' own environments, with observations of the state that they are in and a way back to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import gymnasium_robotics
import mujoco
import numpy as np

from causalbench.task import Seen
from causalbench_mujoco.states import set_state, state_of


class Fresh(gym.Wrapper[Any, Any, Any, Any]):
    """Observes after what derives from the state was computed from it; the environment itself is a substep behind.

    Starts that are not `wanted` are drawn again.
    """

    def __init__(self, env: gym.Env[Any, Any], wanted: Callable[[Any], bool]) -> None:
        super().__init__(env)
        self._wanted = wanted

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        observation, info = self.env.reset(seed=seed, options=options)
        while not self._wanted(observation):
            observation, info = self.env.reset()
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's."""
        _, reward, terminated, truncated, info = self.env.step(action)
        inner = self.unwrapped
        mujoco.mj_forward(inner.model, inner.data)  # type: ignore[attr-defined]
        return inner._get_obs(), reward, terminated, truncated, info  # type: ignore[attr-defined]


def fresh(env_id: str, wanted: Callable[[Any], bool]) -> Fresh:
    """A new environment of that id, without its time limit."""
    gym.register_envs(gymnasium_robotics)
    return Fresh(gym.make(env_id, render_mode="rgb_array", max_episode_steps=-1, disable_env_checker=True), wanted)


def snapshot(env: Any) -> bytes:
    """The goal and MuJoCo's state."""
    inner = env.unwrapped
    return np.concatenate([inner.goal, state_of(inner.model, inner.data)]).tobytes()


def restore(env: Any, content: bytes) -> Seen:
    """The way back, to the bit."""
    inner, numbers = env.unwrapped, np.frombuffer(content).copy()
    inner.goal, state = numbers[: len(inner.goal)].copy(), numbers[len(inner.goal) :]
    set_state(inner.model, inner.data, state)
    return Seen(inner._get_obs(), {})
