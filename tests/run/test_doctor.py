"""`causalbench doctor` finds each planted fault and names what to do."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from causalbench.plugins import Plugins
from causalbench.run.doctor import examine, probe


def _findings(jobs: int = 1) -> dict:
    return {finding.subject: finding for finding in examine(Plugins(), jobs)}


def test_a_sound_machine_has_nothing_to_mend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert {finding.ok for finding in _findings().values()} == {True}


def test_too_many_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", str(2 * (os.cpu_count() or 1)))
    finding = _findings()["threads"]
    assert not finding.ok
    assert "OMP_NUM_THREADS=1" in finding.advice


def test_a_cache_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("a file where a folder must be")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    finding = _findings()["compilation cache"]
    assert not finding.ok
    assert str(tmp_path / "file") in finding.text
    assert "NUMBA_CACHE_DIR" in finding.advice


def test_every_backend_is_really_tried(backend: str) -> None:
    assert probe(backend, "simulates") == ""
    assert "unknown backend" in probe(backend + "x", "simulates")


def _doctor(site: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]) if site else os.environ.get("PYTHONPATH", "")
    command = [sys.executable, "-m", "causalbench", "doctor", "--jobs", "1"]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | environment | {"PYTHONPATH": path})


BROKEN_PLUGIN = "import a_simulator_that_is_not_there\n"


def test_a_plugin_that_cannot_be_imported_and_a_broken_mujoco(install: Callable[[str, str], Path]) -> None:
    site = install("causalbench-broken", BROKEN_PLUGIN)
    (site / "mujoco-4.0.0.dist-info").mkdir()
    (site / "mujoco-4.0.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: mujoco\nVersion: 4.0.0\n")
    done = _doctor(site)
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    failed = [line for line in lines if line.startswith("FAIL")]
    assert any("plugin causalbench-broken" in line and "a_simulator_that_is_not_there" in line for line in failed)
    assert any(line.startswith("FAIL  gymrob: simulates") and "4.0.0" in line for line in failed)
    assert any(line.startswith("ok    kinematic: simulates") for line in lines)


def test_no_opengl_where_pictures_are_asked_for() -> None:
    done = _doctor(MUJOCO_GL="nonsense")
    assert done.returncode == 1
    assert any(line.startswith("FAIL  gymrob: renders") for line in done.stdout.splitlines())
    assert "apt-get install libegl1" in done.stdout
