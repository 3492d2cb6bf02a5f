"""The backends under test: every one of this repository is among them and works here; `--backend` narrows."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import backend_option
import pytest

from causalbench.plugins.manager import installed

ROOT = Path(__file__).parents[1]


def test_every_plugin_of_this_repository_is_installed():
    """A plugin or simulator that is missing must fail here: tests that are parametrized over it would not exist."""
    projects = [tomllib.loads(path.read_text()) for path in ROOT.glob("plugins/*_backend/pyproject.toml")]
    named = {name for project in projects for name in project["project"]["entry-points"]["causalbench"]}
    assert len(named) >= 3
    assert {"kinematic", *named} <= set(installed().backends)
    assert backend_option.names()[0] == "kinematic"


def test_the_backends_that_drive_are_under_test():
    assert {"kinematic", "gymrob", "pybullet"} <= set(backend_option.driving())


def test_every_plugin_loads():
    assert {row.distribution: row.error for row in installed().rows if row.error} == {}


@pytest.mark.parametrize("backend", backend_option.names())
def test_the_simulator_is_installed(backend):
    assert installed().problem(backend) == ""


def collect(*arguments: str) -> subprocess.CompletedProcess[str]:
    places = ["tests/test_backends.py", "tests/conformance/test_installed.py", "plugins/pybullet_backend/tests"]
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", *arguments, *places]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.parametrize("wanted", [pytest.param(("kinematic",), marks=pytest.mark.long), ("pybullet", "gymrob")])
def test_the_option_narrows_to_the_named_backends(wanted):
    shown = collect(*(f"--backend={name}" for name in wanted)).stdout
    assert {name for name in backend_option.names() if f"test_the_simulator_is_installed[{name}]" in shown} == {*wanted}
    assert ("TestConformance_kinematic" in shown) == ("kinematic" in wanted)
    assert ("plugins/pybullet_backend" in shown) == ("pybullet" in wanted)
    assert "test_every_plugin_loads" in shown


def test_an_unknown_backend_is_an_error_that_lists_the_installed_ones():
    done = collect("--backend=gymrobot")
    assert done.returncode == 4
    assert f"--backend gymrobot: not installed; installed are {', '.join(backend_option.names())}" in done.stderr
