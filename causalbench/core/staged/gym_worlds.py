"""Staged worlds that are Gymnasium environments, whatever they simulate: `GymTask` x n environments."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.gym_starts import GymStarts
from causalbench.core.staged.gym_world import GymWorld
from causalbench.core.staged.observation import (
    Observation,
    Observe,
    checked_choice,
    features_space,
    no_sectors,
    sense_nothing,
)
from causalbench.core.staged.worlds import Origin, Step, Worlds, check_count
from causalbench.core.tasks.gym_task import GymTask
from causalbench.core.world.capabilities import Capability

Array = NDArray[np.float64]


def make_gym_worlds(task: GymTask, backend: str, options: Mapping[str, Any], n: int | None = None) -> GymWorlds:
    """New worlds of `task`, one or `n` that step together: with three arguments bound, a `MakeWorlds`."""
    check_count(n)
    each = [GymWorld(task, task.environments[backend](**options)) for _ in range(n or 1)]
    worlds = GymWorlds(task, each, backend, options, () if n is None else (n,))
    worlds.recipe = functools.partial(make_gym_worlds, task, backend, options, n)
    return worlds


class GymWorlds(Worlds):
    """A task in one environment, shape (), or in n that are stepped one after the other, shape (n,)."""

    def __init__(
        self,
        task: GymTask,
        worlds: Sequence[GymWorld],
        backend: str,
        options: Mapping[str, Any],
        shape: tuple[int, ...],
    ) -> None:
        self.task: GymTask = task
        self.worlds, self.shape = tuple(worlds), shape
        env = self.worlds[0].env
        name = env.spec.id if env.spec else type(env.unwrapped).__name__
        self.origin = Origin(backend, f"gymnasium {gym.__version__}", name)
        self.identity = {"backend": backend, "gymnasium": gym.__version__, "env": name, "options": dict(options)}
        self.capabilities = task.capabilities | ({Capability.RGB} if env.render_mode == "rgb_array" else set())
        self.render_fps = int(env.metadata.get("render_fps", 30))
        self.stage = np.zeros(shape, dtype=np.int64)
        self._starts = GymStarts(task, self._count)
        self.choose_observation()

    def _count(self) -> None:
        self.env_steps += 1

    def _read(self) -> None:
        self.stage = np.array([world.stage for world in self.worlds], dtype=np.int64).reshape(self.shape)

    def reset(self, worlds: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None) -> None:
        """See `Worlds`; a start of any stage is one of the environment's own."""
        for index, rng in zip(worlds, rngs, strict=True):
            if stage is None:
                self.worlds[index].reset(rng)
            else:
                self._starts.enter(self.worlds[index], rng, stage)
        self._read()

    def forget_starts(self) -> None:
        """See `Worlds`."""
        self._starts.forget()

    def _step(self, actions: Array, repeat: int) -> Step:
        """See `Worlds`."""
        rows = actions.reshape(self.n, -1)
        steps = [world.step(row, repeat) for world, row in zip(self.worlds, rows, strict=True)]
        columns = map(np.array, zip(*steps, strict=True))
        return Step(*(column.reshape((*self.shape, *column.shape[1:])) for column in columns))

    def _observed(self) -> NDArray[np.float32]:
        rows = [world.observed() for world in self.worlds]
        return np.array(rows, dtype=np.float32).reshape(*self.shape, len(self.task.state_names))

    def states(self) -> NDArray[np.float32]:
        """See `Worlds`."""
        state = self._observed()
        return np.concatenate([state, self.task.features_of(state)], axis=-1) if self._features else state

    def sense(self, sensor: str) -> NDArray[Any]:
        """See `Worlds`."""
        return sense_nothing(self.task, sensor, self.shape)

    def choose_observation(self, gripper: bool = True, observe: Observe = "state", features: bool = True) -> None:
        """See `Worlds`; there is nothing but features to choose."""
        if observe == "sectors":
            raise no_sectors(self.task)
        self._features = features and bool(self.task.feature_names)
        self.observed = checked_choice(gripper, observe, features)
        self._low, self._high = (np.asarray(bound, dtype=np.float32) for bound in self.task.state_bounds)
        state, stage = gym.spaces.Box(self._low, self._high, dtype=np.float32), gym.spaces.Discrete(self.task.n_stages)
        seen = {"features": features_space(self.task)} if self._features else {}
        self.observation_space = gym.spaces.Dict({"state": state, **seen, "stage": stage})

    def observe(self) -> Observation:
        """See `Worlds`."""
        state = self._observed().clip(self._low, self._high)
        seen = {"features": self.task.features_of(state)} if self._features else {}
        return {"state": state, **seen, "stage": self.stage - 1}

    def snapshot(self, world: int) -> bytes:
        """See `Worlds`."""
        self.require(Capability.RESTORE, "taking a snapshot")
        return self.worlds[world].snapshot()

    def restore(self, worlds: Sequence[int], snapshots: Sequence[bytes]) -> None:
        """See `Worlds`."""
        self.require(Capability.RESTORE, "returning to a snapshot")
        for index, snapshot in zip(worlds, snapshots, strict=True):
            self.worlds[index].restore(snapshot)
        self._read()

    def expert(self, worlds: Sequence[int] | None = None) -> Array:
        """See `Worlds`."""
        self.require(Capability.EXPERT, "acting as the expert")
        rows = np.array([self.worlds[index].expert() for index in (range(self.n) if worlds is None else worlds)])
        return rows.reshape(*self.shape, -1) if worlds is None else rows

    def render(self, width: int, height: int) -> NDArray[np.uint8]:
        """See `Worlds`; what the environments draw, brought to the size that is asked for."""
        self.require(Capability.RGB, "drawing a picture")
        pictures = [_resized(np.asarray(world.env.render()), width, height) for world in self.worlds]
        return np.array(pictures, dtype=np.uint8).reshape(*self.shape, height, width, 3)

    def close(self) -> None:
        """See `Worlds`."""
        for world in self.worlds:
            world.env.close()


def _resized(picture: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """The picture (rows, columns, 3) by its nearest pixels, stretched to (height, width, 3)."""
    rows, columns = (np.arange(n) * m // n for n, m in zip((height, width), picture.shape, strict=False))
    return picture[rows][:, columns]
