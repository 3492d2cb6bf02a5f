"""What agents see of scenes: facts to observations, and to the inputs of a model of the rewards."""

from __future__ import annotations

from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics.compiled import compiled
from causalbench.core.numerics.gufunc import broadcast
from causalbench.core.tasks.stage_task import FEATURE_BOUND, StageTask
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene
from causalbench.core.world.cameras import HEIGHT, WIDTH
from causalbench.core.world.facts import Facts
from causalbench.core.world.lidar import MAX_RANGE, N_RAYS, N_SECTORS, sectors
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import UnknownNameError, UserError

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Observation = dict[str, Any]
Observe = Literal["state", "sectors", "paper"]
"""What is observed: the state variables, or beside them how near something is in each sector of the LiDAR, or what the
paper's agents see, `StageTask.paper_sensor`."""


def checked_choice(gripper: bool, observe: Observe, features: bool) -> tuple[bool, Observe, bool]:
    """The same; raises `UserError` for what can be none of these."""
    for name, value in (("observe_gripper", gripper), ("features", features)):
        if not isinstance(value, bool):
            raise UserError(f"{name} {value!r}: expected True or False")
    if observe not in get_args(Observe):
        raise UnknownNameError("observation", observe, get_args(Observe))
    return gripper, observe, features


class Observer:
    """Facts to observations, and to the inputs of a model of the rewards; `space` is a Dict of

    - `state`: the paper's variables, float32, clipped to the task's bounds;
    - `features`: what the task computes from `state`, float32 (n_features,), in a task that has features, unless
      `features` is False;
    - `stage`: stage - 1, for routing;
    - `gripper`: opening in metres, float32 (1,), in a task that observes it, unless `gripper` is False (the paper has
      none);
    - `lidar`: ranges in metres, float32 (220,), in a task that observes it;
    - `sectors`: how near something is in each sector of the LiDAR, float32 (20,) from 0 for nothing to 1, with
      `observe="sectors"` in a task that observes the LiDAR, see `lidar.sectors`;
    - `rgb`: the picture of the camera "scene", uint8 (48, 64, 3), with `observe="paper"` in a task with that sensor.
    """

    def __init__(self, task: Task, spec: SceneSpec, gripper: bool, observe: Observe, features: bool) -> None:
        sensor = task.sensor_in(observe)
        if sensor and sensor not in spec.capabilities:
            raise UserError(
                f"backend {spec.backend!r} has no capability {sensor!r}, which the paper's observation of task "
                f"{task.name!r} needs; `causalbench backends` lists those that have it"
            )
        self._sectors = observe == "sectors"
        if self._sectors and "lidar" not in task.observes:
            raise no_sectors(task)
        self._task, self._names = task, tuple(sorted({sensor, *task.observes} - {"", "gripper"}))
        self._gripper, self._features = gripper and "gripper" in task.observes, features and bool(task.feature_names)
        low, high = (bound.astype(np.float32) for bound in task.state_bounds(spec.workspace))
        spaces: dict[str, gym.Space[Any]] = {
            "state": gym.spaces.Box(low, high, dtype=np.float32),
            "stage": gym.spaces.Discrete(task.n_stages),
        }
        if self._features:
            spaces["features"] = features_space(task)
        if self._gripper:
            spaces["gripper"] = gym.spaces.Box(0.0, spec.max_opening, (1,), np.float32)
        if self._sectors:
            spaces["sectors"] = gym.spaces.Box(0.0, 1.0, (N_SECTORS,), np.float32)
        self.space = gym.spaces.Dict(spaces | {name: SENSORS[name] for name in self._names})
        # The opening is clipped together with the state, in one array that is the observation's own.
        self._low, self._high = np.append(low, np.float32(0)), np.append(high, np.float32(spec.max_opening))

    def __call__(self, facts: Facts, stage: NDArray[np.int64], world: Scene | BatchScene) -> Observation:
        """The observation of `facts` in `stage`; `world` is asked for what is sensed beside them."""
        values = _bounded(self._task.observe(facts), facts.gripper_opening, self._low, self._high)
        obs: Observation = {"state": values[..., :-1], "stage": stage - 1}
        if self._features:
            obs["features"] = self._task.features_of(obs["state"])
        if self._gripper:
            obs["gripper"] = values[..., -1:]
        for name in self._names:
            obs[name] = sense(world, name)
        if self._sectors:
            obs["sectors"] = sectors(obs["lidar"])
        return obs

    def model_inputs(self, facts: Facts, world: Scene | BatchScene) -> NDArray[np.float32]:
        """(..., n_inputs) what a model of the rewards sees: all that they depend on, features and sectors."""
        state, opening = self._task.observe(facts), np.asarray(facts.gripper_opening)[..., None]
        parts = [np.concatenate([state, opening], axis=-1).astype(np.float32)]
        if self._features:
            parts.append(self._task.features_of(parts[0][..., :-1]))
        if self._sectors:
            parts.append(sectors(sense(world, "lidar")))
        return np.concatenate(parts, axis=-1)


SENSORS: dict[str, gym.spaces.Box] = {
    "lidar": gym.spaces.Box(0.0, MAX_RANGE, (N_RAYS,), np.float32),
    "rgb": gym.spaces.Box(0, 255, (HEIGHT, WIDTH, 3), np.uint8),
}
"""What can be sensed beside the facts, and the space of it in one world."""


@compiled
def _clipped(value: float, low: float, high: float) -> float:
    if value < low:
        return low
    return high if value > high else value  # NaN stays NaN


@broadcast("f8[:], f8, f4[:], f4[:], f4[:]", "(s),(),(v),(v)->(v)")
def _bounded(state: Array, opening: float, low: Array32, high: Array32, out: Array32) -> None:
    for i in range(len(state)):
        out[i] = _clipped(state[i], low[i], high[i])
    out[-1] = _clipped(opening, low[-1], high[-1])


def no_sectors(task: StageTask) -> UserError:
    """The error for a task that observes no LiDAR."""
    return UserError(f"task {task.name!r} observes no LiDAR, so it has no `sectors`; use `state`")


def sense_nothing(task: StageTask, sensor: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """`Worlds.sense` of worlds of `shape` without sensors: (*shape, 0). Raises `UserError` for any sensor."""
    if sensor:
        raise UserError(f"task {task.name!r} has no sensor {sensor!r}: all that it observes is its state")
    return np.empty((*shape, 0), np.uint8)


def features_space(task: StageTask) -> gym.spaces.Box:
    """The space of the task's features in one world."""
    return gym.spaces.Box(-FEATURE_BOUND, FEATURE_BOUND, (len(task.feature_names),), np.float32)


def sense(world: Scene | BatchScene, sensor: str) -> NDArray[Any]:
    """What `sensor`, one of `SENSORS`, says now."""
    return world.render(WIDTH, HEIGHT) if sensor == "rgb" else world.lidar().astype(np.float32)
