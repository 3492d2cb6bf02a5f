"""Staged worlds that are scenes: `Task` x `Scene`, one alone or a batch."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.observation import Observation, Observe, Observer, checked_choice, sense
from causalbench.core.staged.start_extras import start_extras, with_extras
from causalbench.core.staged.starts import draw_starts
from causalbench.core.staged.worlds import Origin, Step, Worlds, check_count
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene, SceneList, make_batch, select
from causalbench.core.world.capabilities import EVERY_SCENE
from causalbench.core.world.facts import Facts
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import UserError

Array = NDArray[np.float64]


def make_scene_worlds(
    task: Task, make_scene: Callable[[], Scene], n: int | None = None, kind: type[SceneWorlds] | None = None
) -> SceneWorlds:
    """New worlds of `task` in one scene, or in `n` that step together: with two arguments bound, a `MakeWorlds`.

    They are of the class `kind`, `SceneWorlds` if None.
    """
    check_count(n)
    worlds = (kind or SceneWorlds)(task, make_scene() if n is None else make_batch(make_scene, n))
    worlds.recipe = functools.partial(make_scene_worlds, task, make_scene, n, kind)
    worlds.alone = functools.partial(make_scene_worlds, task, make_scene, None, kind)
    return worlds


class Snapshot(bytes):
    """A scene's snapshot, with what was known of the world then: returning to it need not read that again."""

    facts: Facts
    stage: NDArray[np.int64]


class SceneWorlds(Worlds):
    """A task in one scene, shape (), or in the n worlds of a batch, shape (n,).

    `scene` is that scene or batch and `facts` what holds now, the named numbers of the starts among it.
    """

    facts: Facts

    alone: Callable[[], SceneWorlds] | None = None
    """Makes one world like each of these; `make_scene_worlds` sets it."""

    def __init__(self, task: Task, scene: Scene | BatchScene) -> None:
        self.task: Task = task
        self.scene, self.spec = scene, scene.spec
        self._columns = action_columns(task, scene.spec)
        self._all_columns = (
            self._columns.tolist() == list(range(len(scene.spec.actions))) == list(range(len(task.actions)))
        )
        self._batch = scene if isinstance(scene, BatchScene) else SceneList([scene])
        self.shape = (scene.n,) if isinstance(scene, BatchScene) else ()
        self.steps_as_one = not isinstance(self._batch, SceneList)
        self.origin = origin_of(scene.spec)
        self.identity = dataclasses.asdict(scene.spec) | {"capabilities": sorted(scene.spec.capabilities)}
        self.capabilities = scene.spec.capabilities | EVERY_SCENE
        self.render_fps = round(1 / scene.spec.control_dt)
        self.stage = np.zeros(self.shape, dtype=np.int64)
        self._extras: dict[str, Array] = {}
        self._full = np.zeros((*self.shape, len(scene.spec.actions)))
        self.choose_observation()

    def reset(self, worlds: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None) -> None:
        """See `Worlds`."""
        draw_starts(self.task, self._batch, worlds, rngs, stage)
        self._read_starts()
        self._read()

    def _read_starts(self) -> None:
        """Read what facts carry along of the starts, until the next reset or restore."""
        extras = start_extras([self._batch.layout_of(world) for world in range(self.n)])
        self._extras = extras if self.shape else {name: value[0] for name, value in extras.items()}

    def _read(self) -> None:
        """Read what holds now."""
        self.facts = with_extras(self.scene.facts(), self._extras)
        self.stage = self.task.stage(self.facts)

    def _step(self, actions: Array, repeat: int) -> Step:
        """See `Worlds`."""
        full = actions
        if not self._all_columns:
            full = self._full
            full[..., self._columns] = actions[..., : len(self._columns)]
        for _ in range(repeat):
            self.scene.step(full)
        before, self.facts = self.facts, with_extras(self.scene.facts(), self._extras)
        return judge(self.task, self.stage, before, actions, self.facts)

    def states(self) -> NDArray[np.float32]:
        """See `Worlds`."""
        return self._observer.model_inputs(self.facts, self.scene)

    def sense(self, sensor: str) -> NDArray[Any]:
        """See `Worlds`."""
        if not sensor:
            return np.empty((*self.shape, 0), np.uint8)
        return sense(self.scene, sensor).reshape(*self.shape, -1)

    def choose_observation(self, gripper: bool = True, observe: Observe = "state", features: bool = True) -> None:
        """See `Worlds`."""
        self.observed = checked_choice(gripper, observe, features)
        self._observer = Observer(self.task, self.spec, gripper, observe, features)
        self.observation_space = self._observer.space

    def observe(self) -> Observation:
        """See `Worlds`."""
        return self._observer(self.facts, self.stage, self.scene)

    def snapshot(self, world: int) -> bytes:
        """See `Worlds`."""
        if self.shape:
            return self._batch.snapshot(world)
        taken = Snapshot(self._batch.snapshot(world))
        taken.facts, taken.stage = self.facts, self.stage
        return taken

    def restore(self, worlds: Sequence[int], snapshots: Sequence[bytes]) -> None:
        """See `Worlds`."""
        for world, snapshot in zip(worlds, snapshots, strict=True):
            self._batch.restore(world, snapshot)
        self._read_starts()
        if not self.shape and isinstance(snapshots[0], Snapshot):
            self.facts, self.stage = snapshots[0].facts, snapshots[0].stage
        else:
            self._read()

    def expert(self, worlds: Sequence[int] | None = None) -> Array:
        """See `Worlds`."""
        if not self.shape:
            return self.task.expert(self.facts, self.spec, self._batch.layout_of(0))
        chosen = np.arange(self.n) if worlds is None else np.asarray(worlds)
        maps = [layout for world in chosen.tolist() if (layout := self._batch.layout_of(world)) is not None]
        return self.task.expert(select(self.facts, chosen), self.spec, maps if len(maps) == len(chosen) else None)

    def after_success(self, world: int) -> bool | None:
        """See `Worlds`."""
        if self.task.after_success is None:
            return None
        if not isinstance(self._batch, SceneList):
            return self._copied(world).after_success(0)
        stood = self.task.after_success(self._batch.scenes[world])
        self._read()
        return stood

    def _copied(self, world: int) -> SceneWorlds:
        """One world in the state of `world`. Raises `UserError` where nothing says how to make one."""
        if self.alone is None:
            raise UserError(f"a success in one of {self.n} worlds that only step together cannot be tested")
        copied = self.alone()
        copied.restore([0], [self.snapshot(world)])
        return copied

    def render(self, width: int, height: int) -> NDArray[np.uint8]:
        """See `Worlds`."""
        return self.scene.render(width, height, self.task.camera)

    def close(self) -> None:
        """See `Worlds`."""
        self.scene.close()


def judge(task: Task, stage: NDArray[np.int64], before: Facts, actions: Array, now: Facts) -> Step:
    """What the change by `actions` from `before`, in `stage` = U(before), to `now` meant to `task`."""
    next_stage, success = task.stage(now), task.success(stage, now)
    rewards = task.rewards(before, stage, actions, now, next_stage)
    return Step(stage, next_stage, rewards, success, (next_stage < stage) & ~success, success)


def origin_of(spec: SceneSpec) -> Origin:
    """What scenes of `spec` are made of."""
    return Origin(f"{spec.backend} {spec.backend_version}", spec.engine_text, spec.robot)


def action_columns(task: Task, spec: SceneSpec) -> NDArray[np.int64]:
    """Where each task action stands in the scene's action vector; a `UserError` names what is missing.

    Actions that no scene executes, which are the last ones, stand nowhere.
    """
    missing = [a for a in task.scene_actions if a not in spec.actions]
    lacking = sorted(task.requires - spec.capabilities)
    if missing or lacking:
        raise UserError(
            f"backend {spec.backend!r} cannot run task {task.name!r}: missing actions {missing}, "
            f"missing capabilities {lacking}"
        )
    return np.array([spec.actions.index(a) for a in task.scene_actions])
