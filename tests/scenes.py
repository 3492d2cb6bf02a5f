"""Scenes as the worlds of a task, and scenes that count their control steps themselves."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from causalbench.core.discovery import pipeline
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.core.staged.worlds import MakeWorlds
from causalbench.core.tasks.task import Task
from causalbench.core.world.scene import Scene


def worlds_of(task: Task, make_scene: Callable[[], Scene]) -> MakeWorlds:
    """What learners and discovery take, of scenes."""
    return partial(make_scene_worlds, task, make_scene)


def counting(make_scene: Callable[[], Scene]) -> tuple[Callable[[], Scene], list[int]]:
    """A maker of scenes, and the control steps of each scene that it makes."""
    counts: list[int] = []

    def make() -> Scene:
        scene, number = make_scene(), len(counts)
        step = scene.step
        counts.append(0)

        def counted(action):
            counts[number] += 1
            step(action)

        scene.step = counted
        return scene

    return make, counts


def discover(task: Task, make_scene: Callable[[], Scene], *arguments: Any, **options: Any) -> CausalGraph:
    """`pipeline.discover` in worlds of scenes."""
    return pipeline.discover(task, worlds_of(task, make_scene), *arguments, **options)
