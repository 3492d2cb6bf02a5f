"""gymnasium-robotics' own environments, with observations of the state that they are in and a way back to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import gymnasium_robotics
import mujoco
import numpy as np
from numpy.typing import NDArray

from causalbench.task import Seen

STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # with mocap bodies and the solver's warm start


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


def state_of(inner: Any) -> NDArray[np.float64]:
    """MuJoCo's state of an environment that has a model and data."""
    state = np.empty(mujoco.mj_stateSize(inner.model, STATE))
    mujoco.mj_getState(inner.model, inner.data, state, STATE)
    return state


def set_state(inner: Any, state: NDArray[np.float64]) -> None:
    """The way back, to the bit, and what derives from it."""
    mujoco.mj_setState(inner.model, inner.data, state, STATE)
    mujoco.mj_forward(inner.model, inner.data)
    mujoco.mj_setState(inner.model, inner.data, state, STATE)  # computing that has warmed the solver otherwise


def snapshot(env: Any) -> bytes:
    """The goal and MuJoCo's state."""
    return np.concatenate([env.unwrapped.goal, state_of(env.unwrapped)]).tobytes()


def restore(env: Any, content: bytes) -> Seen:
    """The way back, to the bit."""
    inner, numbers = env.unwrapped, np.frombuffer(content).copy()
    inner.goal, state = numbers[: len(inner.goal)].copy(), numbers[len(inner.goal) :]
    set_state(inner, state)
    return Seen(inner._get_obs(), {})
