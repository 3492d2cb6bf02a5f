"""gymnasium-robotics' FrankaKitchen for `franka_kitchen`: no noise, nothing latches, and a way back."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import gymnasium_robotics
import mujoco
import numpy as np
from gymnasium_robotics.envs.franka_kitchen.kitchen_env import OBS_ELEMENT_GOALS, OBS_ELEMENT_INDICES
from numpy.typing import NDArray

from causalbench.task import Seen
from causalbench_mujoco.states import set_state, state_of

Array = NDArray[np.float64]

ELEMENTS = ("microwave", "kettle", "light switch", "slide cabinet")
SITES = ("microhandle_site", "kettle_site", "light_site", "slide_site")
HAND = "end_effector"


class Kitchen(gym.Wrapper[Any, Any, Any, Any]):
    """Shows the state that it is in (28,): joints, hand, ways of the hand to the handles, what the elements lack."""

    def __init__(self, jitter: float) -> None:
        self.jitter = jitter
        gym.register_envs(gymnasium_robotics)
        super().__init__(
            gym.make(
                "FrankaKitchen-v1", tasks_to_complete=list(ELEMENTS), terminate_on_tasks_completed=False,
                remove_task_when_completed=False, object_noise_ratio=0.0, robot_noise_ratio=0.0,
                max_episode_steps=-1, disable_env_checker=True,
            )
        )  # fmt: skip
        self.inner: Any = self.unwrapped
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (28,))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """The environment's one start, with the arm moved a little."""
        self.env.reset(seed=seed, options=options)
        self.inner.data.qpos[:7] += self.inner.np_random.uniform(-self.jitter, self.jitter, 7)
        return self.settled(), {}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """The environment's step, of which nothing is kept but the reward."""
        _, reward, _, _, _ = self.env.step(action)
        mujoco.mj_forward(self.inner.model, self.inner.data)
        return self.look(), reward, False, False, {}

    def settled(self) -> Array:
        """What is seen, after the state was set from outside."""
        mujoco.mj_forward(self.inner.model, self.inner.data)
        self.inner.robot_env._last_robot_qpos = self.inner.data.qpos[:9].copy()
        return self.look()

    def look(self) -> Array:
        """What is seen of the state now."""
        data = self.inner.data
        hand = data.site(HAND).xpos
        ways = [data.site(site).xpos - hand for site in SITES]
        lack = [np.linalg.norm(data.qpos[OBS_ELEMENT_INDICES[name]] - OBS_ELEMENT_GOALS[name]) for name in ELEMENTS]
        return np.concatenate([data.qpos[:9], hand, *ways, lack])


def put(env: Any, seed: int, stage: int, off: Array) -> Seen:
    """A start in `stage`: the elements before it done, the hand `off` (3,) m from the handle of its own."""
    env.reset(seed=seed)
    model, data = env.inner.model, env.inner.data
    for name in ELEMENTS[: stage - 1]:
        data.qpos[OBS_ELEMENT_INDICES[name]] = OBS_ELEMENT_GOALS[name]
    mujoco.mj_forward(model, data)
    _reach(model, data, data.site(SITES[stage - 1]).xpos + off)
    return Seen(env.settled(), {})


def _reach(model: Any, data: Any, goal: Array) -> None:
    """Bring the hand to `goal` (3,) m, by damped least squares over the arm's joints."""
    jacobian, site = np.zeros((3, model.nv)), model.site(HAND).id
    for _ in range(60):
        error = goal - data.site_xpos[site]
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        j = jacobian[:, :7]
        data.qpos[:7] += j.T @ np.linalg.solve(j @ j.T + 1e-3 * np.eye(3), 0.5 * error)
        data.qpos[:7] = np.clip(data.qpos[:7], *model.jnt_range[:7].T)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)


def snapshot(env: Any) -> bytes:
    """MuJoCo's state; all else of this environment is constant or follows from it."""
    return state_of(env.unwrapped.model, env.unwrapped.data).tobytes()


def restore(env: Any, content: bytes) -> Seen:
    """The way back, to the bit."""
    inner = env.unwrapped
    set_state(inner.model, inner.data, np.frombuffer(content).copy())
    inner.robot_env._last_robot_qpos = inner.data.qpos[:9].copy()
    return Seen(env.look(), {})
