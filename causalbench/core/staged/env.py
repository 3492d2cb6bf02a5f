"""Gymnasium environment = Scene x Task: the scalar through `step`, the named vector in `info["vector_reward"]`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene, SceneList
from causalbench.core.world.cameras import HEIGHT, WIDTH
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.lidar import MAX_RANGE, N_RAYS
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import InvalidActionError, LayoutDrawError, UnreachableLayoutError, UserError

MAX_DRAWS = 200
"""Starts that may be refused in a row before a reset gives up."""

Observation = dict[str, Any]
Observe = Literal["state", "paper"]
"""What is observed: the state variables, or beside them what the paper's agents see, `StageTask.paper_sensor`."""


def reset_worlds(
    task: Task, batch: BatchScene, indices: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None
) -> list[Layout]:
    """Reset worlds `indices` of `batch`, each to a start drawn from its own generator; the starts, in that order.

    A start is drawn again until it is reachable, free of contact, holds nothing and lies inside `stage` (any if None).
    Raises `LayoutDrawError` after `MAX_DRAWS` refused draws.
    """
    pending = list(zip(indices, rngs, strict=True))
    layouts: dict[int, Layout] = {}
    refusal = "none"
    for _ in range(MAX_DRAWS):
        placed = []
        for world in pending:
            try:
                layouts[world[0]] = _place(task, batch, *world, stage or 1)
                placed.append(world[0])
            except UnreachableLayoutError as error:
                refusal = str(error)
        good: set[int] = set()
        if placed:  # a world that refused its first start has no facts yet
            facts = batch.facts_of(placed)
            usable = ~(facts.collision_base | facts.collision_arm | facts.collision_self | facts.holding)
            if stage is not None:
                usable &= task.stage(facts) == stage
            good = {index for index, fine in zip(placed, usable, strict=True) if fine}
        pending = [world for world in pending if world[0] not in good]
        if not pending:
            return [layouts[index] for index in indices]
    where = "" if stage is None else f" in stage {stage}"
    raise LayoutDrawError(
        f"task {task.name!r} found no start{where} on backend {batch.spec.backend!r} in {MAX_DRAWS} draws: "
        f"each was refused by the scene, in contact or in another stage. The last refusal: {refusal}. The declared "
        f"workspace: {batch.spec.workspace}"
    )


def _place(task: Task, batch: BatchScene, index: int, rng: np.random.Generator, stage: int) -> Layout:
    """Draw a layout and put the world into it. Raises `UnreachableLayoutError`."""
    layout = task.draw_layout(rng, batch.spec.workspace, batch.spec.max_opening, stage)
    batch.reset(index, layout)
    return layout


def action_columns(task: Task, spec: SceneSpec) -> NDArray[np.int64]:
    """Where each task action stands in the scene's action vector; a `UserError` names what is missing."""
    missing = [a for a in task.actions if a not in spec.actions]
    lacking = sorted(task.requires - spec.capabilities)
    if missing or lacking:
        raise UserError(
            f"backend {spec.backend!r} cannot run task {task.name!r}: missing actions {missing}, "
            f"missing capabilities {lacking}"
        )
    return np.array([spec.actions.index(a) for a in task.actions])


class Observer:
    """Facts to observations; `space` is a Dict of

    - `state`: the paper's variables, float32, clipped to the task's bounds;
    - `stage`: stage - 1, for routing;
    - `gripper`: opening in metres, float32 (1,), in a task that observes it, with `observe_gripper`;
    - `lidar`: ranges in metres, float32 (220,), only in a task that observes it;
    - `rgb`: the picture of the camera "scene", uint8 (48, 64, 3), with `observe="paper"` in a task with that sensor.
    """

    def __init__(self, task: Task, spec: SceneSpec, observe_gripper: bool, observe: Observe = "state") -> None:
        sensor = task.sensor_in(observe)
        if sensor and sensor not in spec.capabilities:
            raise UserError(
                f"backend {spec.backend!r} has no capability {sensor!r}, which the paper's observation of task "
                f"{task.name!r} needs; `causalbench backends` lists those that have it"
            )
        self.sees = sensor == "rgb"
        low, high = (bound.astype(np.float32) for bound in task.state_bounds(spec.workspace))
        self.scans = "lidar" in task.observes
        observe_gripper = observe_gripper and "gripper" in task.observes
        self._task, self._n_state, self._observe_gripper = task, len(low), observe_gripper
        spaces: dict[str, gym.Space[Any]] = {
            "state": gym.spaces.Box(low, high, dtype=np.float32),
            "stage": gym.spaces.Discrete(task.n_stages),
        }
        if observe_gripper:
            spaces["gripper"] = gym.spaces.Box(0.0, spec.max_opening, (1,), np.float32)
        if self.scans:
            spaces["lidar"] = gym.spaces.Box(0.0, MAX_RANGE, (N_RAYS,), np.float32)
        if self.sees:
            spaces["rgb"] = gym.spaces.Box(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
        self.space = gym.spaces.Dict(spaces)
        # The opening is clipped together with the state, in one array that is the observation's own.
        self._low, self._high = np.append(low, np.float32(0)), np.append(high, np.float32(spec.max_opening))

    def __call__(self, facts: Facts, stage: NDArray[np.int64], world: Scene | BatchScene) -> Observation:
        """The observation of `facts` in `stage`; `world` is asked for what is sensed beside them."""
        values = np.empty((*facts.gripper_opening.shape, self._n_state + 1), dtype=np.float32)
        values[..., :-1] = self._task.observe(facts)
        values[..., -1] = facts.gripper_opening
        np.maximum(values, self._low, out=values)
        np.minimum(values, self._high, out=values)
        obs: Observation = {"state": values[..., :-1], "stage": stage - 1}
        if self._observe_gripper:
            obs["gripper"] = values[..., -1:]
        if self.scans:
            obs["lidar"] = world.lidar().astype(np.float32)
        if self.sees:
            obs["rgb"] = world.render(WIDTH, HEIGHT)
        return obs


class StageTaskEnv(gym.Env[Observation, NDArray[np.float32]]):
    """A staged task in one scene.

    Observation: see `Observer`.
    Action: (n_actions,) float32 in [-1, 1], names in `action_names`; 0 means "not executed".
    Reward: the sum of the active terms. Reward vector: `info["vector_reward"]`, float64 (n_terms,), named
    `reward_names`, space `reward_space` (the MO-Gymnasium convention).
    `info` also has `stage` and `next_stage` (from 1, as in the paper), `reversal`, `is_success`.
    `terminated` is the task's verdict, `truncated` the clock (`task.horizon` control steps).
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium declares it as an instance variable

    make_scene: Callable[[], Scene] | None = None
    """Makes another scene like this one's; `make_env` sets it, and `causalbench.train` needs it."""

    def __init__(
        self,
        task: Task,
        scene: Scene,
        render_mode: str | None = None,
        observe_gripper: bool = True,
        observe: Observe = "state",
    ) -> None:
        self.task, self.scene, self.render_mode = task, scene, render_mode
        self.observe_gripper, self.observe = observe_gripper, observe
        self._columns = action_columns(task, scene.spec)
        self._full_action = np.zeros(len(scene.spec.actions))
        self.metadata = self.metadata | {"render_fps": round(1 / scene.spec.control_dt)}
        self.action_names, self.reward_names = task.actions, task.term_names
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(task.actions),), np.float32)
        self.reward_space = gym.spaces.Box(-np.inf, np.inf, (len(task.terms),), np.float64)
        self._observer = Observer(task, scene.spec, observe_gripper, observe)
        self.observation_space = self._observer.space
        self._clock = 0
        self._facts: Facts | None = None
        self._layout: Layout | None = None
        self._stage: NDArray[np.int64] = np.array(0)

    @property
    def facts(self) -> Facts:
        """What holds now; before the first reset an error."""
        if self._facts is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        return self._facts

    @property
    def layout(self) -> Layout:
        """The start of this episode, which is also its map; before the first reset an error."""
        if self._layout is None:
            raise gym.error.ResetNeeded("call reset() first")
        return self._layout

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new start, drawn from `self.np_random`; `options={"stage": i}` starts inside stage i."""
        super().reset(seed=seed)
        stage = (options or {}).get("stage")
        if stage is not None and stage not in range(1, self.task.n_stages + 1):
            raise UserError(f"options: stage {stage!r} is not one of 1 to {self.task.n_stages} of {self.task.name}")
        (self._layout,) = reset_worlds(self.task, SceneList([self.scene]), [0], [self.np_random], stage)
        self._facts = self.scene.facts()
        self._stage = self.task.stage(self._facts)
        self._clock = 0
        return self._observer(self._facts, self._stage, self.scene), {"stage": int(self._stage)}

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One control step; see the class for what comes back. Raises `InvalidActionError`."""
        previous, stage = self.facts, self._stage
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (len(self.action_names),):
            raise InvalidActionError(f"action has shape {action.shape}, expected ({len(self.action_names)},)")
        self._full_action[self._columns] = action
        self.scene.step(self._full_action)  # the scene refuses what is not finite or leaves [-1, 1]
        now = self.scene.facts()
        result = judge(self.task, stage, previous, action, now)
        self._facts, self._stage = now, result.next_stage
        self._clock += 1
        info = {
            "vector_reward": result.vector_reward,
            "stage": int(stage),
            "next_stage": int(result.next_stage),
            "reversal": bool(result.reversal),
            "is_success": bool(result.success),
        }
        terminated = bool(result.success)
        truncated = self._clock >= self.task.horizon and not terminated
        obs = self._observer(now, self._stage, self.scene)
        return obs, float(result.vector_reward.sum()), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the task's camera, 480 x 360, when `render_mode` is "rgb_array"."""
        return self.scene.render(480, 360, self.task.camera) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the scene; may be called twice."""
        self.scene.close()


class VectorReward(gym.Wrapper[Observation, NDArray[np.float32], Observation, NDArray[np.float32]]):
    """Returns the reward vector from `step`, so that MO-Gymnasium wrappers and morl-baselines run as they are."""

    def step(self, action: NDArray[Any]) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """As `StageTaskEnv.step`, the reward being float32 (n_terms,)."""
        obs, _, terminated, truncated, info = self.env.step(action)
        return obs, info["vector_reward"].astype(np.float32), terminated, truncated, info
