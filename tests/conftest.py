"""Backends under test. A backend joins every protocol test by its name in `BACKENDS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from causalbench.core.env import StageTaskEnv
from causalbench.core.kinematic import KinematicScene
from causalbench.core.scene import Scene
from causalbench.core.tasks.pure_manipulation import TASK

# Named, not looked up: a plugin that is not installed must fail here, never go missing.
BACKENDS = ("kinematic",)


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def make_scene(backend: str) -> Iterator[Callable[[], Scene]]:
    """A function that makes scenes of the backend; they are closed after the test."""
    scenes: list[Scene] = []

    def make() -> Scene:
        scenes.append(KinematicScene())
        return scenes[-1]

    yield make
    for scene in scenes:
        scene.close()


@pytest.fixture
def make_pure(make_scene: Callable[[], Scene]) -> Callable[..., StageTaskEnv]:
    """A function that makes pure manipulation environments of the backend."""

    def make(**options) -> StageTaskEnv:
        return StageTaskEnv(TASK, make_scene(), **options)

    return make
