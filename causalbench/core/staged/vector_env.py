"""Several worlds of one staged task stepped at once, as a vector environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from causalbench.core.staged.observation import Observation, Observe
from causalbench.core.staged.reset_request import (
    MASK,
    STAGE,
    checked_mask,
    checked_options,
    checked_seeds,
    checked_stage,
)
from causalbench.core.staged.worlds import Worlds
from causalbench.errors import UserError


class StageTaskVectorEnv(gym.vector.VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """`StageTaskEnv` with a leading dimension n, reset within the step that ends an episode (SAME_STEP).

    `infos` holds arrays of the step, not of the reset that may follow it: `vector_reward` (n, n_terms), `stage` and
    `next_stage` (from 1), `reversal`, `is_success`, `terminated`, and `final_obs`, the observation before any reset, of
    every world. Where an episode has ended it also has what Gymnasium's own vector environments have: `final_info`, the
    same arrays with a mask `_NAME` (n,) beside each, and the masks `_final_obs` and `_final_info`.
    World i draws its starts from its own generator, seeded with [seed, i], or with its entry in a list of seeds.
    """

    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}  # noqa: RUF012 - as in Gymnasium

    def __init__(
        self, worlds: Worlds, observe_gripper: bool = True, observe: Observe = "state", features: bool = True
    ) -> None:
        if not worlds.shape:
            raise UserError("StageTaskVectorEnv takes worlds of shape (n,), got one of shape ()")
        self.worlds, self.task, self.num_envs = worlds, worlds.task, worlds.n
        worlds.choose_observation(observe_gripper, observe, features)
        self.single_observation_space = worlds.observation_space
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (len(self.task.actions),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, worlds.n)
        self.action_space = batch_space(self.single_action_space, worlds.n)
        self._clock = np.zeros(worlds.n, dtype=np.int64)
        self._rngs: list[np.random.Generator] = []

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """New starts in every world; `options={"stage": i}` starts inside stage i.

        `options={"reset_mask": mask}`, a bool array (n,), resets the worlds of the mask alone and leaves the others,
        which must have been reset before. Raises `UserError` for a seed that is none and for other options.
        """
        asked = checked_options(options, (STAGE, MASK))
        stage, chosen = checked_stage(asked, self.task), checked_mask(asked, self.num_envs)
        seeds = checked_seeds(seed, self.num_envs)
        if not self._rngs:
            if len(chosen) < self.num_envs:
                raise UserError("options: reset_mask: every world must be reset before some of them are")
            self._rngs = [np.random.default_rng() for _ in seeds]
        for i in chosen:
            if seeds[i] is not None:
                self._rngs[i] = np.random.default_rng(seeds[i])
        self._restart(chosen, stage)
        return self.worlds.observe(), {"stage": self.worlds.stage.copy()}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One control step of every world; see the class. Raises `InvalidActionError`."""
        if not self._rngs:
            raise gym.error.ResetNeeded("call reset() before step()")
        step = self.worlds.step(actions)
        self._clock += 1
        truncated = (self._clock >= self.task.horizon) & ~step.terminated
        final_obs = obs = self.worlds.observe()
        over = np.flatnonzero(step.terminated | truncated)
        if over.size:
            self._restart(over)
            obs = self.worlds.observe()
        infos = {
            "vector_reward": step.rewards,
            "stage": step.stage,
            "next_stage": step.next_stage,
            "reversal": step.reversal,
            "is_success": step.success,
            "terminated": step.terminated,
            "final_obs": final_obs,
        }
        if over.size:
            infos |= _final(infos, step.terminated | truncated)
        return obs, step.rewards.sum(1), step.terminated, truncated, infos

    def _restart(self, over: NDArray[np.int64], stage: int | None = None) -> None:
        self.worlds.reset(over.tolist(), [self._rngs[i] for i in over], stage)
        self._clock[over] = 0

    def state(self) -> dict[str, Any]:
        """Everything that later steps depend on: a snapshot, a clock and a generator for each world."""
        snapshots = {f"world{i}": np.frombuffer(self.worlds.snapshot(i), np.uint8) for i in range(self.num_envs)}
        return snapshots | {"clock": self._clock.copy(), "rngs": [rng.bit_generator.state for rng in self._rngs]}

    def load_state(self, state: Mapping[str, Any]) -> Observation:
        """Go on from `state`, bit for bit if the worlds have "exact_restore"; what they then observe."""
        snapshots = [np.asarray(state[f"world{i}"]).tobytes() for i in range(self.num_envs)]
        self.worlds.restore(range(self.num_envs), snapshots)
        self._clock[:] = state["clock"]
        self._rngs = [np.random.default_rng() for _ in range(self.num_envs)]
        for rng, rng_state in zip(self._rngs, state["rngs"], strict=True):
            rng.bit_generator.state = rng_state
        return self.worlds.observe()

    def close(self, **kwargs: Any) -> None:
        """Close the worlds; may be called twice."""
        self.worlds.close()


def _final(infos: Mapping[str, Any], ended: NDArray[np.bool_]) -> dict[str, Any]:
    """What Gymnasium's vector environments add in SAME_STEP mode on a step on which some worlds have `ended`."""
    own = {name: value for name, value in infos.items() if name != "final_obs"}
    masks = {f"_{name}": ended for name in own}
    return {"final_info": own | masks, "_final_info": ended, "_final_obs": ended}
