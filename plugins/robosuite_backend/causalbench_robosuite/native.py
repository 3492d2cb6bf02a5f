"""robosuite's own environments for Gymnasium, seeded, showing the state that they are in, with a way back to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from causalbench.task import Seen
from causalbench_mujoco.states import STATE, set_state, state_of
from causalbench_robosuite.model import quiet

Array = NDArray[np.float64]
Look = Callable[[Any], Array]


class Native(gym.Env[Array, Array]):
    """An environment of robosuite's with its stock robot and controller; what `look(env)` reads is its observation.

    Its model is loaded once. Its own observables, which are as old as the last substep's start, are switched off.
    """

    def __init__(self, name: str, look: Look, robots: int, **options: Any) -> None:
        with quiet():
            import robosuite

            self.inner = robosuite.make(
                name, robots=["Panda"] * robots, hard_reset=False, ignore_done=True, use_camera_obs=False,
                has_offscreen_renderer=False, reward_shaping=True, **options,
            )  # fmt: skip
        self.inner._update_observables = lambda force=False: None
        self._look = look
        low, high = self.inner.action_spec
        self.action_space = gym.spaces.Box(low, high, dtype=np.float64)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, look(self.inner).shape, dtype=np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """A start of the environment's own, which depends on the seed alone."""
        super().reset(seed=seed)
        if seed is not None:  # its samplers share this generator
            self.inner.rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state
        with quiet():
            self.inner.reset()
        _look_anew(self.inner)
        return self.look(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """The environment's step; nothing ends it."""
        reward = self.inner.step(action)[1]
        self.inner.sim.forward()
        return self.look(), float(reward), False, False, {}

    def look(self) -> Array:
        """What is seen of the state now."""
        return np.array(self._look(self.inner), dtype=np.float64)


def _look_anew(inner: Any) -> None:
    """Let controllers compute from the state as it is; after a reset they know one with other fingers."""
    for robot in inner.robots:
        for controller in robot.part_controllers.values():
            controller.new_update = True


def _memory(inner: Any) -> list[Array]:
    """What outlives a step beside MuJoCo's state: moved bodies, the fingers' command, the posture that arms keep."""
    model = inner.sim.model._model
    arrays = [model.body_pos, model.body_quat]
    for robot in inner.robots:
        for arm in robot.arms:
            gripper = robot.gripper[arm]
            gripper.current_action = np.zeros(len(gripper.actuators)) + gripper.current_action
            arrays += [gripper.current_action, robot.part_controllers[arm].initial_joint]
    return arrays


def snapshot(env: Any) -> bytes:
    """All of its state."""
    sim = env.unwrapped.inner.sim
    state = state_of(sim.model._model, sim.data._data)
    return np.concatenate([state, *(array.ravel() for array in _memory(env.unwrapped.inner))]).tobytes()


def restore(env: Any, content: bytes) -> Seen:
    """The way back, to the bit."""
    inner, numbers = env.unwrapped.inner, np.frombuffer(content).copy()
    model, data = inner.sim.model._model, inner.sim.data._data
    state, rest = np.split(numbers, [mujoco.mj_stateSize(model, STATE)])
    for array in _memory(inner):
        array[...], rest = rest[: array.size].reshape(array.shape), rest[array.size :]
    set_state(model, data, state)
    _look_anew(inner)
    return Seen(env.unwrapped.look(), {})
