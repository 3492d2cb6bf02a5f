"""`causalbench doctor` finds each planted fault and names what to do."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import backend_option
import pytest

from causalbench.plugins.manager import Plugins
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


CACHE = "from causalbench.run.doctor import _cache; f = _cache(); print(f.ok, f.text, f.advice, sep='|', end='')"


def _cache(**environment: str) -> list[str]:
    """What a new process finds about its cache: numba reads its settings when it is imported."""
    command = [sys.executable, "-c", CACHE]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, env=os.environ | environment
    ).stdout.split("|")


def test_a_cache_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("a file where a folder must be")
    chosen = str(tmp_path / "file")
    ok, text, advice = _cache(NUMBA_CACHE_DIR=chosen)
    assert ok == "False"
    assert text.startswith(f"NUMBA_CACHE_DIR, {chosen}, cannot be written; /")
    assert text.endswith("is used instead")
    assert advice == "set NUMBA_CACHE_DIR to a folder that you can write to"
    ok, text, _ = _cache(NUMBA_CACHE_DIR=chosen, NUMBA_CACHE_LOCATOR_CLASSES="UserProvidedCacheLocator")
    assert (ok, text) == (
        "False",
        f"NUMBA_CACHE_DIR, {chosen}, cannot be written: every process compiles for a minute or so",
    )
    ok, text, advice = _cache(NUMBA_CACHE_DIR=str(tmp_path / "new"))
    assert (ok, Path(text).parent, advice) == ("True", tmp_path / "new", "")


def test_compilation_that_is_switched_off() -> None:
    ok, text, advice = _cache(NUMBA_DISABLE_JIT="1")
    assert (ok, advice) == ("False", "unset NUMBA_DISABLE_JIT")
    assert text == "inner loops run as plain Python, since NUMBA_DISABLE_JIT is set"


@pytest.mark.parametrize("backend", backend_option.names())
def test_every_backend_is_really_tried(backend: str) -> None:
    assert probe(backend, "simulates") == ""


def test_a_backend_that_does_not_exist_is_no_success() -> None:
    assert "unknown backend" in probe("kinematicx", "simulates")


BROKEN_PLUGIN = "import a_simulator_that_is_not_there\n"


def test_a_plugin_that_cannot_be_imported_and_a_broken_mujoco(
    install: Callable[[str, str], Path], use_plugins: Callable[..., None], cli: Callable
) -> None:
    site = install("causalbench-broken", BROKEN_PLUGIN)
    (site / "mujoco-4.0.0.dist-info").mkdir()
    (site / "mujoco-4.0.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: mujoco\nVersion: 4.0.0\n")
    use_plugins(site, ["kinematic", "gymrob"])
    done = cli("doctor", "--jobs", "1")
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    failed = [line for line in lines if line.startswith("FAIL")]
    assert any("plugin causalbench-broken" in line and "a_simulator_that_is_not_there" in line for line in failed)
    assert any(line.startswith("FAIL  gymrob: simulates") and "4.0.0" in line for line in failed)
    assert any(line.startswith("ok    kinematic: simulates") for line in lines)


@pytest.mark.long
def test_a_mujoco_that_cannot_be_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mujoco.py").write_text('raise ImportError("libmujoco.so.3: cannot open shared object file")\n')
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    assert "libmujoco.so.3: cannot open shared object file" in probe("gymrob", "simulates")
    assert probe("pybullet", "simulates") == ""


@pytest.mark.long
def test_no_opengl_where_pictures_are_asked_for(
    use_plugins: Callable[..., None], cli: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GLFW without a display, which is what MuJoCo tries by itself on a machine without a screen."""
    for name, value in {"MUJOCO_GL": "glfw", "DISPLAY": "", "WAYLAND_DISPLAY": ""}.items():
        monkeypatch.setenv(name, value)
    use_plugins(backends=["gymrob"])
    done = cli("doctor", "--jobs", "1")
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    assert any(line.startswith("FAIL  gymrob: renders") for line in lines)
    assert any(line.startswith("ok    gymrob: simulates") for line in lines)
    assert "apt-get install libegl1" in done.stdout
