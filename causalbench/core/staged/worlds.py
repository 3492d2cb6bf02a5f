"""THE step: worlds of one staged task, the only place where an action becomes a judged transition.

Environments, discovery, the oracle, evaluation and conformance all go through `Worlds.step`. What the worlds are made
of is up to two classes: `SceneWorlds`, a task over scenes, and `GymWorlds`, one over any Gymnasium environment.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.observation import Observation, Observe
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability, lacking
from causalbench.core.world.scene import check_action
from causalbench.errors import UserError

Array = NDArray[np.float64]


class Step(NamedTuple):
    """What one step meant to the task; every field has the worlds' shape."""

    stage: NDArray[np.int64]  # U(s) before it, from 1; the rewards belong to it
    next_stage: NDArray[np.int64]  # U(s') after it
    rewards: Array  # (*shape, n_terms), 0 for terms that are not active in `stage`
    success: NDArray[np.bool_]  # the task's verdict
    reversal: NDArray[np.bool_]  # U(s') < U(s) on a step that is not success
    terminated: NDArray[np.bool_]  # success, or a world that cannot go on: it must be reset before the next step


@dataclass(frozen=True)
class Origin:
    """What the worlds are made of: names with versions."""

    backend: str
    engine: str
    robot: str


class Worlds(ABC):
    """Worlds of one staged task that step together, of `shape` () for one or (n,) for several.

    A deep copy or a pickle is made anew by `recipe` and brought to the same state by snapshots, because simulators keep
    state that Python does not see. Both raise `UserError` where there is no recipe or no capability `RESTORE`.

    - `stage`: U(s) of every world, int64 (*shape), from 1;
    - `origin` for people and tables, `identity` as JSON data: all that two runs must share to be comparable;
    - `capabilities`: what the worlds can do, see `Capability`;
    - `env_steps`: control steps taken so far in all worlds together, whoever asked for them;
    - `render_fps`: control steps a second, for films;
    - `observation_space`: of one world, and `observed`, what was chosen, see `choose_observation`.
    """

    task: StageTask
    shape: tuple[int, ...]
    origin: Origin
    identity: Mapping[str, Any]
    capabilities: frozenset[Capability]
    render_fps: int
    observation_space: gym.spaces.Dict
    observed: tuple[bool, Observe, bool]
    stage: NDArray[np.int64]
    env_steps: int = 0

    steps_as_one: bool = False
    """Whether several such worlds are stepped as one, so that many take hardly more time than one."""

    recipe: Callable[[], Worlds] | None = None
    """Makes other worlds like these, not reset yet; every `MakeWorlds` sets it."""

    @property
    def n(self) -> int:
        """How many worlds."""
        return self.shape[0] if self.shape else 1

    @abstractmethod
    def reset(self, worlds: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None) -> None:
        """Put some worlds into starts, each drawn from its own generator; inside `stage`, any if None.

        Raises `LayoutDrawError` when no such start is found.
        """

    def forget_starts(self) -> None:  # noqa: B027 - optional; most worlds keep none
        """Let go of what resets keep to save steps, so that what follows takes as many whatever came before."""

    def step(self, actions: Array, repeat: int = 1) -> Step:
        """Hold `actions` (*shape, n_actions), in [-1, 1], for `repeat` control steps and judge what came of it.

        Raises `InvalidActionError` before anything moves.
        """
        checked = check_action(actions, (*self.shape, len(self.task.actions)))
        step = self._step(self.task.executed(checked), repeat)
        self.stage = step.next_stage
        self.env_steps += self.n * repeat
        return step

    @abstractmethod
    def _step(self, actions: Array, repeat: int) -> Step:
        """Move the worlds by checked `actions` and judge the change from what was before."""

    @abstractmethod
    def states(self) -> NDArray[np.float32]:
        """(*shape, n_inputs) what a model of the rewards sees, as `choose_observation` says; see `task.input_names`.

        All that they depend on is part of it.
        """

    @abstractmethod
    def sense(self, sensor: str) -> NDArray[Any]:
        """(*shape, size) what a sensor, "rgb" or "lidar", says; size 0 for "".

        Raises `UserError` where there is none such.
        """

    @abstractmethod
    def choose_observation(self, gripper: bool = True, observe: Observe = "state", features: bool = True) -> None:
        """Choose what `observe` returns: with the gripper's opening or without, and what stands beside the state.

        Both it and `states` have the task's features unless `features` is False, and the LiDAR's sectors if `observe`
        is "sectors".

        Raises `UserError` for a sensor that the worlds do not have.
        """

    @abstractmethod
    def observe(self) -> Observation:
        """What an agent sees of every world now, each entry with leading dimensions `shape`."""

    @abstractmethod
    def snapshot(self, world: int) -> bytes:
        """All of one world's state, for `restore`; needs the capability `RESTORE`."""

    @abstractmethod
    def restore(self, worlds: Sequence[int], snapshots: Sequence[bytes]) -> None:
        """Return some worlds, each to a snapshot of any world of equal `identity`, also of another process."""

    @abstractmethod
    def expert(self, worlds: Sequence[int] | None = None) -> Array:
        """The scripted expert's actions, (*shape, n_actions), or (len(worlds), n_actions) of some worlds alone.

        Needs the capability `EXPERT`.
        """

    def after_success(self, world: int) -> bool | None:
        """Put a success of one world to the task's own test, which steps it; None where nothing follows a success."""
        return None

    @abstractmethod
    def render(self, width: int, height: int) -> NDArray[np.uint8]:
        """What people see: RGB pictures (*shape, height, width, 3); needs the capability `RGB`."""

    @abstractmethod
    def close(self) -> None:
        """Release what the worlds hold; may be called twice."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _remade, self._kept()

    def __deepcopy__(self, memo: dict[int, Any]) -> Worlds:
        recipe, kept = self._kept()
        return _remade(recipe, copy.deepcopy(kept, memo))

    def _kept(self) -> tuple[Callable[[], Worlds], _Kept]:
        """What `_remade` needs. Raises `UserError` where a copy cannot be made."""
        if self.recipe is None:
            raise UserError("these worlds cannot be copied or pickled: nothing says how to make more; use make_env")
        began = bool(self.stage.all())
        if began:
            self.require(Capability.RESTORE, "copying or pickling worlds")
        snapshots = [self.snapshot(world) for world in range(self.n)] if began else []
        return self.recipe, _Kept(snapshots, self.observed, self.env_steps)

    def require(self, capability: Capability, purpose: str) -> None:
        """Raise a `UserError` that says what for, unless the worlds have `capability`."""
        if capability not in self.capabilities:
            raise UserError(lacking(capability, purpose, self.origin.backend, self.task.name))


class _Kept(NamedTuple):
    snapshots: list[bytes]  # of every world; empty before the first reset
    observed: tuple[bool, Observe, bool]
    env_steps: int


def _remade(recipe: Callable[[], Worlds], kept: _Kept) -> Worlds:
    """Worlds of `recipe` in the state that was kept of others."""
    worlds = recipe()
    worlds.choose_observation(*kept.observed)
    if kept.snapshots:
        worlds.restore(range(worlds.n), kept.snapshots)
    worlds.env_steps = kept.env_steps
    return worlds


class MakeWorlds(Protocol):
    """Makes new worlds: `make_worlds()` one of shape (), `make_worlds(n)` several of shape (n,). Best picklable."""

    def __call__(self, n: int | None = None) -> Worlds:
        """New worlds, not reset yet."""


def check_count(n: object) -> None:
    """Raise `UserError` unless `n` may be how many worlds `MakeWorlds` shall make."""
    if n is not None and (isinstance(n, bool) or not isinstance(n, int) or n < 1):
        raise UserError(f"{n!r} worlds: expected a whole number from 1, or None for one world of shape ()")
