"""Settings that every test shares."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import backend_option
import installing
import pytest
import torch

# Compiles the task: the first compilation on a machine is announced on stderr, which tests of processes compare.
import causalbench.core.kinematic.mobile
import causalbench.core.tasks.mobile_manipulation
import causalbench.core.tasks.pure_manipulation  # noqa: F401
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.world.scene import Scene
from causalbench.plugins.manager import installed
from causalbench.registration import make_env

# Two threads in each of several test processes on a few cores wait for each other: up to 50 times slower.
torch.set_num_threads(1)


@pytest.fixture
def backends(request: pytest.FixtureRequest) -> tuple[str, ...]:
    """Names of all backends under test."""
    return backend_option.chosen(request.config)


@pytest.fixture(params=backend_option.names())
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


@pytest.fixture(params=backend_option.driving())
def mobile_env(request: pytest.FixtureRequest) -> Iterator[StageTaskEnv]:
    """Mobile manipulation in one backend."""
    env = make_env("mobile_manipulation", request.param)
    yield env
    env.close()


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


@pytest.fixture(scope="module")
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the distribution that the test module names as its `EXAMPLE` is installed."""
    folder = tmp_path_factory.mktemp("site")
    installing.install(request.module.EXAMPLE, folder)
    return folder


TINY = """\
schema: 1
name: tiny
task: pure_manipulation
backends: [kinematic]
methods: [cmSAC, mSAC]
tiers:
  smoke: {seeds: 1, env_steps: 120}
evaluation: {every: 60, episodes: 1, final_episodes: 1}
# Every action whose KL is not 0 counts: 20 samples find no cause, and a cause is what cmSAC needs to run at all.
discovery: {training_count: 20, sequence_length: 5, n_placebos: 0, oracle_states: 3,
  kl: {max_epochs: 1, epsilon_cv: 1000, epsilon_direct: 0}}
learner: {learning_starts: 20, net_arch: [8], batch_size: 8}
"""
"""A suite that runs in seconds on the kinematic backend."""


@pytest.fixture(scope="session")
def tiny_suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("suite") / "tiny.yaml"
    path.write_text(TINY)
    return path


@pytest.fixture(scope="session")
def command() -> list[str]:
    """How to start the command line: the installed script, or the module where there is only a search path."""
    script = Path(sys.executable).with_name("causalbench")
    return [str(script)] if script.exists() else [sys.executable, "-m", "causalbench"]


@pytest.fixture(scope="session")
def timed_run(tiny_suite: Path, command: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """The folder of an uninterrupted run of the tiny suite, and the seconds it took."""
    out = tmp_path_factory.mktemp("run") / "whole"
    arguments = ["run", str(tiny_suite), "--tier", "smoke", "--out", str(out), "--jobs", "2"]
    started = time.monotonic()
    subprocess.run([*command, *arguments], capture_output=True, text=True, check=True)
    return out, time.monotonic() - started


@pytest.fixture(scope="session")
def finished_run(timed_run: tuple[Path, float]) -> Path:
    """The folder of an uninterrupted run of the tiny suite; tests must not change it."""
    return timed_run[0]
