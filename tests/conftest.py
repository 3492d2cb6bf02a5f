"""Backends under test. A backend joins every protocol test by its name in `BACKENDS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from causalbench.core.env import StageTaskEnv
from causalbench.core.scene import Scene
from causalbench.plugins import installed
from causalbench.registration import make_env

# Named, not looked up: a plugin or simulator that is not installed must fail here, never go missing.
BACKENDS = ("kinematic", "gymrob")


@pytest.fixture
def backends() -> tuple[str, ...]:
    """Names of all backends under test."""
    return BACKENDS


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def make_scene(backend: str) -> Iterator[Callable[[], Scene]]:
    """A function that makes scenes of the backend; they are closed after the test."""
    scenes: list[Scene] = []

    def make() -> Scene:
        scenes.append(installed().backend(backend).make())
        return scenes[-1]

    yield make
    for scene in scenes:
        scene.close()


@pytest.fixture
def make_pure(backend: str) -> Iterator[Callable[..., StageTaskEnv]]:
    """A function that makes pure manipulation environments of the backend; they are closed after the test."""
    envs: list[StageTaskEnv] = []

    def make(**options: Any) -> StageTaskEnv:
        envs.append(make_env("pure_manipulation", backend, **options))
        return envs[-1]

    yield make
    for env in envs:
        env.close()
