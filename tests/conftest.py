"""Backends under test. A backend joins every protocol test by its name in `BACKENDS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

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


@pytest.fixture
def install(tmp_path: Path) -> Callable[[str, str], Path]:
    """A function (distribution, source of its module) that installs a fake plugin, version 1.0.

    It returns the folder that must be on the search path for it to be found.
    """
    site = tmp_path / "site"

    def write(distribution: str, source: str) -> Path:
        module = distribution.replace("-", "_")
        info = site / f"{module}-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[causalbench]\n{module} = {module}\n")
        (site / f"{module}.py").write_text(source)
        return site

    return write
