"""`StageTaskVectorEnv` as stable-baselines3 wants it: one reward a step, scaled observations, time limits in `info`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from causalbench.core.learners.counting import Counter
from causalbench.core.learners.policy import ObservationScale
from causalbench.core.learners.scalars import Scalar
from causalbench.core.staged.observation import Observation
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.stage_task import FEATURE_BOUND


class ScalarRewardEnv(VecEnv):
    """`StageTaskVectorEnv` as SB3 wants it: scaled observations (n, n_obs), a scalar reward; counts what happens."""

    def __init__(self, env: StageTaskVectorEnv, scale: ObservationScale, scalar: Scalar, seed: int) -> None:
        self.env, self.scale, self.scalar, self.first_seed = env, scale, scalar, seed
        self.obs: Observation = {}
        self.counter = Counter(env.task.n_stages, env.num_envs)
        self.stage = np.ones(env.num_envs, dtype=np.int64)
        self._actions: NDArray[Any] = np.zeros((env.num_envs, len(env.task.actions)))
        space = gym.spaces.Box(-FEATURE_BOUND, FEATURE_BOUND, (scale.n_inputs,), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """New starts in every world, the same for every method with this seed."""
        self.obs, _ = self.env.reset(seed=self.first_seed)
        return self.scale(self.obs).numpy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[np.bool_], list[dict[str, Any]]]:
        """One control step of every world."""
        before = self.obs
        self.obs, _, terminated, truncated, infos = self.env.step(self._actions)
        over = terminated | truncated
        rewards = self.scalar(before, infos, over)
        self.counter.add(infos, over)
        self.stage = self.obs["stage"] + 1
        final_obs = self.scale(infos["final_obs"]).numpy()
        sb3_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for world in np.flatnonzero(over):
            sb3_infos[world] = {
                "terminal_observation": final_obs[world],
                "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
            }
        return self.scale(self.obs).numpy(), rewards.astype(np.float32), over, sb3_infos

    def close(self) -> None:
        """The owner of the worlds closes them."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Of the vector environment, the same for each world."""
        return [getattr(self.env, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Nothing to set: the worlds are one batch."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Nothing to call: the worlds are one batch."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: Any = None) -> list[bool]:
        """No wrappers."""
        return [False] * self.num_envs
