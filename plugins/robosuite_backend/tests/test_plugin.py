from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import causalbench_robosuite
from causalbench.core.scene import Scene
from causalbench.errors import BrokenVersionError, InvalidActionError, UserError
from causalbench.hookspecs import Backend
from causalbench_robosuite import make, versions


def test_importing_the_plugin_imports_no_simulator() -> None:
    script = (
        "import sys, causalbench_robosuite as plugin\n"
        "backends = []; plugin.causalbench_backends(backends.append)\n"
        "assert backends[0].name == 'robosuite'\n"
        "assert not {'mujoco', 'robosuite', 'numba'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_it_registers_one_backend() -> None:
    backends: list[Backend] = []
    causalbench_robosuite.causalbench_backends(backends.append)
    assert [(b.name, b.engine, b.robot) for b in backends] == [("robosuite", "MuJoCo", "Panda")]


@pytest.mark.parametrize("version", ["2.3.7", "3.2.7", "3.4.0", "3.10.0", "3.17.0", "4.0.0"])
def test_a_broken_mujoco_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    monkeypatch.setattr(versions.metadata, "version", lambda name: version if name == "mujoco" else "1.5.2")
    with pytest.raises(BrokenVersionError, match=rf'{version}.*pip install "mujoco==3\.3\.7"'):
        make()


def test_another_robosuite_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(versions.metadata, "version", lambda name: "3.3.7" if name == "mujoco" else "1.4.1")
    with pytest.raises(BrokenVersionError, match=r'1\.4\.1.*pip install "robosuite==1\.5\.2"'):
        make()


def test_a_control_step_must_be_whole() -> None:
    with pytest.raises(UserError, match="whole number"):
        make(control_hz=10.0, timestep=0.003)


@pytest.mark.parametrize("action", [np.zeros(6), np.full(7, np.nan), np.full(7, 1.5)])
def test_a_bad_action_is_refused(scene: Scene, action: np.ndarray) -> None:
    with pytest.raises(InvalidActionError):
        scene.step(action)
