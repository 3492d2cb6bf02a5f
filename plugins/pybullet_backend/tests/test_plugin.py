from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import causalbench_pybullet
from causalbench.core.scene import Scene
from causalbench.errors import BrokenVersionError, CausalbenchError, InvalidActionError, UserError
from causalbench.hookspecs import Backend
from causalbench_pybullet import make, versions


def test_importing_the_plugin_imports_no_simulator() -> None:
    script = (
        "import sys, causalbench_pybullet; backends = []; causalbench_pybullet.causalbench_backends(backends.append)\n"
        "assert backends[0].name == 'pybullet'\n"
        "assert not {'pybullet', 'mujoco', 'gymnasium_robotics', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_the_simulator_writes_nothing_of_its_own() -> None:
    script = "from causalbench_pybullet import make; make().close()"
    done = subprocess.run([sys.executable, "-c", script], check=True, timeout=60, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_it_registers_one_backend() -> None:
    backends: list[Backend] = []
    causalbench_pybullet.causalbench_backends(backends.append)
    assert [(b.name, b.engine, b.robot) for b in backends] == [("pybullet", "Bullet", "Fetch")]


@pytest.mark.parametrize(
    ("name", "version"),
    [("pybullet", "3.2.6"), ("mujoco", "3.2.7"), ("mujoco", "4.0.0"), ("gymnasium-robotics", "1.5.0")],
)
def test_another_version_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch, name: str, version: str) -> None:
    installed = {**versions.TESTED, name: version}
    monkeypatch.setattr(versions.metadata, "version", installed.__getitem__)
    with pytest.raises(BrokenVersionError, match=rf'{version}.*pip install "{name}=={versions.TESTED[name]}"'):
        make()


@pytest.mark.parametrize("options", [{"timestep": 0.003}, {"solver_iterations": 0}])
def test_options_that_cannot_be_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(UserError):
        make(**options)


@pytest.mark.parametrize("action", [np.zeros(6), np.full(7, np.nan), np.full(7, 1.5)])
def test_a_bad_action_is_refused(scene: Scene, action: np.ndarray) -> None:
    with pytest.raises(InvalidActionError):
        scene.step(action)


def test_a_closed_scene_says_so() -> None:
    scene = make()
    scene.close()
    scene.close()
    with pytest.raises(CausalbenchError, match="closed"):
        scene.facts()


def test_there_is_one_camera(grasped: Scene) -> None:
    picture = grasped.render(64, 48)
    assert picture.shape == (48, 64, 3)
    assert picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
    with pytest.raises(UserError, match="camera"):
        grasped.render(64, 48, "nowhere")
