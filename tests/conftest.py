"""Settings that every test shares."""

import dataclasses
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import backend_option
import installing
import pytest
import torch
from kills import call_until
from sharing import made_once

# Compiles the task: the first compilation on a machine is announced on stderr, which tests of processes compare.
import causalbench.core.kinematic.mobile
import causalbench.core.tasks.mobile_manipulation
import causalbench.core.tasks.pure_manipulation  # noqa: F401
from causalbench.cli.app import main
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.world.scene import Scene
from causalbench.plugins import manager
from causalbench.plugins.manager import installed, load_plugins
from causalbench.registration import make_env

# Two threads in each of several test processes on a few cores wait for each other: up to 50 times slower.
torch.set_num_threads(1)


@pytest.fixture(params=backend_option.quick(backend_option.names()))
def backend(request: pytest.FixtureRequest) -> str:
    """Each backend, most of them in long tests; what has to be seen in each one is parametrized over all names."""
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


@pytest.fixture(params=backend_option.quick(backend_option.driving()))
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
    example = request.module.EXAMPLE
    return made_once(tmp_path_factory, f"site_{example.name}", partial(installing.install, example))


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


@pytest.fixture
def cli(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """A function that calls the command line in an empty folder and in this process, which has imported all it needs.

    What the fork server is for needs a process of its own, see `command`.
    """
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["causalbench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        return subprocess.CompletedProcess(sys.argv, int(ended.value.code or 0), out, err)

    return call


@pytest.fixture
def use_plugins(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A function that installs what lies in the folder `site`, for commands of this process and those they start.

    With names of `backends` all others are as if not installed.
    """

    def use(site: Path | None = None, backends: Sequence[str] = ()) -> None:
        if site:
            monkeypatch.syspath_prepend(site)
            monkeypatch.setenv("PYTHONPATH", str(site), prepend=os.pathsep)
        found = load_plugins()
        few = {name: backend for name, backend in found.backends.items() if name in backends or not backends}
        monkeypatch.setattr(manager, "installed", lambda: dataclasses.replace(found, backends=few))

    return use


@pytest.fixture(scope="session")
def counted_run(tiny_suite: Path, command: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The folder of an uninterrupted run of the tiny suite, and how many moves (see `kills`) it took."""

    def make(folder: Path) -> None:
        call = [*command, "run", str(tiny_suite), "--tier", "smoke", "--out", str(folder / "whole"), "--jobs", "2"]
        code, moves = call_until([*call, "--checkpoint-every", "20"], folder)
        assert code == 0
        (folder / "moves").write_text(str(moves))

    made = made_once(tmp_path_factory, "tiny_run", make)
    own = tmp_path_factory.mktemp("run") / "whole"  # commands that lock it must not meet
    return shutil.copytree(made / "whole", own), int((made / "moves").read_text())


@pytest.fixture(scope="session")
def finished_run(counted_run: tuple[Path, int]) -> Path:
    """The folder of an uninterrupted run of the tiny suite; tests must not change it."""
    return counted_run[0]
