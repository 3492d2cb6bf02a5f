"""Several worlds of one staged task stepped at once; the task is judged once for all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from causalbench.core.staged.env import Observation, Observe, Observer, action_columns, reset_worlds
from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene
from causalbench.core.world.facts import Facts
from causalbench.core.world.scene import check_action


class StageTaskVectorEnv(gym.vector.VectorEnv[Observation, NDArray[Any], NDArray[Any]]):
    """`StageTaskEnv` with a leading dimension n, reset within the step that ends an episode (SAME_STEP).

    `infos` holds arrays: `vector_reward` (n, n_terms), `stage` and `next_stage` (from 1), `reversal`, `is_success`,
    and `final_obs`, the observation before any reset, of every world.
    World i draws its starts from its own generator, seeded with [seed, i].
    """

    metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}  # noqa: RUF012 - as in Gymnasium

    def __init__(self, task: Task, batch: BatchScene, observe_gripper: bool = True, observe: Observe = "state") -> None:
        self.task, self.batch, self.num_envs = task, batch, batch.n
        self._columns = action_columns(task, batch.spec)
        self._observer = Observer(task, batch.spec, observe_gripper, observe)
        self.single_observation_space = self._observer.space
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (len(task.actions),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, batch.n)
        self.action_space = batch_space(self.single_action_space, batch.n)
        self._full_action = np.zeros((batch.n, len(batch.spec.actions)))
        self._clock = np.zeros(batch.n, dtype=np.int64)
        self._rngs: list[np.random.Generator] = []
        self._facts: Facts
        self._stage: NDArray[np.int64]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """New starts in every world."""
        if seed is not None or not self._rngs:
            self._rngs = [np.random.default_rng(None if seed is None else [seed, i]) for i in range(self.num_envs)]
        self._restart(np.arange(self.num_envs))
        return self._observer(self._facts, self._stage, self.batch), {"stage": self._stage.copy()}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One control step of every world; see the class. Raises `InvalidActionError`."""
        previous, stage = self._facts, self._stage
        actions = check_action(actions, (self.num_envs, len(self.task.actions)))
        self._full_action[:, self._columns] = actions
        self.batch.step(self._full_action)
        self._facts = self.batch.facts()
        result = judge(self.task, stage, previous, actions, self._facts)
        self._stage = result.next_stage
        self._clock += 1
        truncated = (self._clock >= self.task.horizon) & ~result.success
        final_obs = obs = self._observer(self._facts, self._stage, self.batch)
        over = np.flatnonzero(result.success | truncated)
        if over.size:
            self._restart(over)
            obs = self._observer(self._facts, self._stage, self.batch)
        infos = {
            "vector_reward": result.vector_reward,
            "stage": stage,
            "next_stage": result.next_stage,
            "reversal": result.reversal,
            "is_success": result.success,
            "final_obs": final_obs,
        }
        return obs, result.vector_reward.sum(1), result.success, truncated, infos

    def _restart(self, worlds: NDArray[np.int64]) -> None:
        reset_worlds(self.task, self.batch, worlds.tolist(), [self._rngs[i] for i in worlds])
        self._facts = self.batch.facts()
        self._stage = self.task.stage(self._facts)
        self._clock[worlds] = 0

    def state(self) -> dict[str, Any]:
        """Everything that later steps depend on: a snapshot, a clock, a stage and a generator for each world."""
        snapshots = {f"world{i}": np.frombuffer(data, np.uint8) for i, data in enumerate(self.batch.snapshots())}
        rngs = [rng.bit_generator.state for rng in self._rngs]
        return snapshots | {"clock": self._clock, "stage": self._stage, "rngs": rngs}

    def load_state(self, state: Mapping[str, Any]) -> Observation:
        """Go on from `state`, bit for bit if the backend has "exact_restore"; what the worlds then observe."""
        self.batch.restore([np.asarray(state[f"world{i}"]).tobytes() for i in range(self.num_envs)])
        self._clock[:], self._stage = state["clock"], np.asarray(state["stage"])
        self._rngs = [np.random.default_rng() for _ in range(self.num_envs)]
        for rng, rng_state in zip(self._rngs, state["rngs"], strict=True):
            rng.bit_generator.state = rng_state
        self._facts = self.batch.facts()
        return self._observer(self._facts, self._stage, self.batch)

    def close(self, **kwargs: Any) -> None:
        """Close the worlds; may be called twice."""
        self.batch.close()
