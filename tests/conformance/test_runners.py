"""The two runners: `causalbench check` and `SceneConformance`, on a plugin with a known gap."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from causalbench.conformance.suite import CHECKS

PLUGIN = """
import dataclasses
from causalbench.core.kinematic.scenes import WorldsScene
from causalbench.core.kinematic.spec import SPEC
from causalbench.core.kinematic.worlds import KinematicWorlds
from causalbench.plugins.backends import Backend, Variant
from causalbench.plugins.hookspecs import hookimpl

class Scene(WorldsScene):
    def __init__(self, timestep=0.03):
        super().__init__(KinematicWorlds(()))
        self.spec = dataclasses.replace(SPEC, backend="gappy", timestep=timestep)

@hookimpl
def causalbench_backends(register):
    gaps = {"S4": "the engine rounds its [clock]"}
    register(Backend("gappy", Scene, "numpy", (Variant(SPEC.robot, SPEC.capabilities),), known_gaps=gaps))
"""
TEST = """
from causalbench.conformance.testing import SceneConformance
class TestGap(SceneConformance):
    backend = "gappy"
class TestClosed(SceneConformance):
    backend = "gappy"
    options = {"timestep": 0.1}
"""


@pytest.fixture
def call(install: Callable[[str, str], Path], tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    path = os.pathsep.join(filter(None, [str(install("zz-gappy", PLUGIN)), os.environ.get("PYTHONPATH")]))

    def start(*arguments: str) -> subprocess.CompletedProcess[str]:
        command, env = [sys.executable, "-m", *arguments], os.environ | {"PYTHONPATH": path}
        return subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)

    return start


def test_check_prints_a_table_and_a_known_gap_does_not_fail(call: Callable) -> None:
    done = call("causalbench", "check", "gappy")
    assert (done.returncode, done.stderr) == (0, "")
    row = next(line for line in done.stdout.splitlines() if "S4 " in line)
    assert "known gap" in row
    assert "the engine rounds its [clock] (now: spec.control_dt 0.1 s is 3.33333 timesteps of 0.03 s)" in row
    assert "pass: 42, fail: 0, warning: 0, known gap: 1, not applicable: 11" in done.stdout
    listed = next(line for line in call("causalbench", "backends").stdout.splitlines() if "zz-gappy" in line)
    assert "S4: the engine rounds its [clock]" in listed
    assert "exact_restore" in listed


def test_a_closed_gap_fails_with_exit_code_1_and_points_to_the_text_of_its_line(call: Callable) -> None:
    done = call("causalbench", "check", "gappy", "--option", "timestep=0.1")
    assert done.returncode == 1
    (row,) = (line for line in done.stdout.splitlines() if "│ fail" in line)
    assert row.split("│")[1].strip() == "S4"
    assert row.strip("│ ").endswith("the check says: pass. Remove it from known_gaps")
    place = next(line for line in done.stdout.splitlines() if line.startswith("S4 in full")).rpartition(": ")[2]
    file, _, number = place.rpartition(":")
    lines = Path(file).read_text().splitlines()
    assert lines[int(number) - 1].startswith("def s04_time(")
    assert '"""S4. ' in lines[int(number)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gapy"], "error: unknown backend 'gapy'. Did you mean 'gappy'?"),
        (["gappy", "--option", "timestep"], "error: --option 'timestep': expected name=value"),
        (
            ["gappy", "--option", "step=1"],
            "error: options of backend 'gappy': got an unexpected keyword argument 'step'",
        ),
    ],
)
def test_mistakes_exit_with_2(
    cli: Callable,
    install: Callable[[str, str], Path],
    use_plugins: Callable[..., None],
    arguments: list[str],
    message: str,
) -> None:
    use_plugins(install("zz-gappy", PLUGIN))
    done = cli("check", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)


def test_pytest_expects_a_gap_and_fails_a_closed_one(call: Callable, tmp_path: Path) -> None:
    (tmp_path / "test_gappy.py").write_text(TEST)
    done = call("pytest", "-q", "-rxfs", "-p", "no:cacheprovider", "-k", "s04 or s21", "test_gappy.py")
    others = 2 * (len(CHECKS) - 2)
    assert f"1 failed, 2 skipped, {others} deselected, 1 xfailed" in done.stdout
    assert "FAILED test_gappy.py::TestClosed::test_s04_time" in done.stdout
    assert "XFAIL test_gappy.py::TestGap::test_s04_time - the engine rounds its [clock]" in done.stdout


@pytest.mark.long
def test_a_run_and_its_leaderboard_say_which_gaps_are_known(call: Callable, tiny_suite: Path, tmp_path: Path) -> None:
    text = tiny_suite.read_text().replace("[kinematic]", "[gappy, kinematic]").replace("[cmSAC, mSAC]", "[mSAC]")
    (tmp_path / "gappy.yaml").write_text(text)
    done = call("causalbench", "run", "gappy.yaml", "--tier", "smoke", "--out", "run", "--jobs", "1", "--quiet")
    assert done.returncode == 0, done.stderr
    sessions = json.loads((tmp_path / "run" / "environment.json").read_text())["sessions"]
    assert [session["known_gaps"] for session in sessions] == [
        {"gappy": {"S4": "the engine rounds its [clock]"}, "kinematic": {}}
    ]
    footnote = "Known gap of gappy: S4, the engine rounds its [clock]"
    assert done.stdout.count(footnote) == 1
    assert call("causalbench", "leaderboard", "run", "run").stdout.count(footnote) == 1
