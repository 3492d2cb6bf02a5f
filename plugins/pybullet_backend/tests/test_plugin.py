from __future__ import annotations

import re
import subprocess
import sys
from importlib import metadata
from typing import Any

import pytest

import causalbench_pybullet
from causalbench.backend import Backend, BrokenVersionError, CausalbenchError, UserError
from causalbench_pybullet import RELEASES, make


def test_the_simulator_writes_nothing_of_its_own() -> None:
    script = "from causalbench_pybullet import make; make().close()"
    done = subprocess.run([sys.executable, "-c", script], check=True, timeout=60, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_it_registers_one_backend() -> None:
    backends: list[Backend] = []
    causalbench_pybullet.causalbench_backends(backends.append)
    assert [(b.name, b.engine) for b in backends] == [("pybullet", "Bullet")]
    assert [variant.robot for variant in backends[0].variants] == ["Fetch", "Fetch"]


@pytest.mark.parametrize(
    ("name", "version"),
    [("pybullet", "3.2.6"), ("mujoco", "3.2.7"), ("mujoco", "4.0.0"), ("gymnasium-robotics", "1.5.0")],
)
def test_another_version_is_named_with_its_repair(monkeypatch: pytest.MonkeyPatch, name: str, version: str) -> None:
    installed = {"pybullet": "3.2.7", "mujoco": "3.3.7", "gymnasium-robotics": "1.4.2", name: version}
    monkeypatch.setattr(metadata, "version", installed.__getitem__)
    repair = re.escape(f'{name} {version}. Repair: pip install "{name}{RELEASES[name]}"')
    with pytest.raises(BrokenVersionError, match=repair):
        make()


def test_a_solver_without_iterations_is_refused() -> None:
    with pytest.raises(UserError, match="solver_iterations"):
        make(solver_iterations=0)


@pytest.mark.parametrize(("options", "iterations"), [({}, 20), ({"mobile": True}, 50), ({"solver_iterations": 7}, 7)])
def test_the_spec_says_how_many_iterations_the_solver_makes(options: dict[str, Any], iterations: int) -> None:
    spec = make(**options).spec
    assert (spec.engine_version, spec.engine_settings) == ("3.2.7", {"solver_iterations": iterations})
    assert spec.engine_text == f"Bullet 3.2.7, {iterations} solver iterations"


def test_a_closed_scene_says_so() -> None:
    scene = make()
    scene.close()
    scene.close()
    with pytest.raises(CausalbenchError, match="closed"):
        scene.facts()
