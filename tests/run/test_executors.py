"""A cell that raises, exits, crashes, is killed or hangs ends alone; what depends on it is skipped with a sentence."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from causalbench.plugins.manager import installed
from causalbench.processes import start
from causalbench.run import cell_log
from causalbench.run.cell import Keeping
from causalbench.run.cell_log import LIMIT
from causalbench.run.executors import processes
from causalbench.run.executors.cell_process import STOPPED, settle
from causalbench.run.executors.processes import PRELOAD, Processes
from causalbench.run.executors.schedule import Queue
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import DiscoveryCell, LearnerCell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite

PLUGIN = """
import ctypes, os, signal, sys, threading
from causalbench.errors import DivergedError
from causalbench.plugins.backends import Backend, Variant
from causalbench.plugins.hookspecs import hookimpl

def raising():
    raise RuntimeError("the arm fell off")

def chatty():
    for _ in range(100):
        os.write(1, b"noise\\n" * 20_000)
    raise RuntimeError("the last word")

def diverging():
    raise DivergedError("a loss is not finite")

WAYS = {
    "raising": raising,
    "chatty": chatty,
    "diverging": diverging,
    "leaving": lambda: sys.exit(0),
    "exiting": lambda: os._exit(3),
    "killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "segfaulting": lambda: ctypes.string_at(0),
    "hanging": lambda: threading.Event().wait(),
}

@hookimpl
def causalbench_backends(register):
    for name, make in WAYS.items():
        register(Backend(name, make, "none", (Variant("none"),)))
"""


@pytest.fixture
def run(
    install: Callable[[str, str], Path], tiny_suite: Path, command: list[str], tmp_path: Path
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """A function that runs the tiny suite on the given crashing backends with more arguments."""
    site = install("causalbench-crashing", PLUGIN)
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]).strip(os.pathsep)}
    suite = tmp_path / "suite.yaml"

    def start(backends: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        suite.write_text(tiny_suite.read_text().replace("[kinematic]", f"[{backends}]"))
        call = [*command, "run", str(suite), "--tier", "smoke", "--out", str(tmp_path / "run"), "--quiet", *arguments]
        return subprocess.run(call, capture_output=True, text=True, env=env)

    return start


def reasons(run: Path) -> dict[tuple[str, str], tuple[str, str]]:
    """(backend, method or "discovery") -> (state, reason)."""
    found = {}
    for path in run.glob("*/*/cell.json"):
        cell, status = json.loads(path.read_text()), json.loads((path.parent / "status.json").read_text())
        what = cell["method"]["name"] if cell["kind"] == "learner" else "discovery"
        found[cell["backend"]["name"], what] = (status["state"], status["reason"])
    return found


def test_each_way_to_die_ends_one_cell_and_the_rest_goes_on(run: Callable, tmp_path: Path) -> None:
    done = run("raising, exiting, killed, segfaulting, kinematic", "--jobs", "2")
    assert done.returncode == 1
    found = reasons(tmp_path / "run")
    assert found["kinematic", "mSAC"] == ("done", "")
    assert found["kinematic", "cmSAC"] == ("done", "")
    assert found["raising", "mSAC"] == ("failed", "RuntimeError: the arm fell off")
    assert found["exiting", "mSAC"] == ("failed", "its process exited with code 3; see log.txt")
    assert found["killed", "mSAC"] == ("failed", "its process was killed by SIGKILL; see log.txt")
    assert found["segfaulting", "mSAC"] == ("failed", "its process was killed by SIGSEGV; see log.txt")
    for backend in ("raising", "exiting", "killed", "segfaulting"):
        state, reason = found[backend, "cmSAC"]
        assert state == "skipped"
        assert reason.startswith(f"its causal discovery pure_manipulation-{backend}-s0-")
        assert reason.endswith(" is failed, so there is no graph")
    logs = {path.parent.name.split("-")[1]: path.read_text() for path in tmp_path.glob("run/cells/*mSAC-s0*/log.txt")}
    assert "raise RuntimeError" in logs["raising"]
    assert "Fatal Python error: Segmentation fault" in logs["segfaulting"]
    assert "failed. its process was killed by SIGSEGV" in done.stdout


def test_a_hang_ends_at_the_time_limit_and_counts_until_it_is_retried(run: Callable, tmp_path: Path) -> None:
    limit = ("--only", "method=mSAC", "--timeout", "0.02")
    # Without a limit, which a busy machine might take to import torch.
    assert run("hanging, diverging", *limit[:2], "--only", "backend=diverging").returncode == 1
    assert run("hanging, diverging", *limit).returncode == 1
    found = reasons(tmp_path / "run")
    assert found["hanging", "mSAC"] == ("timeout", "stopped at the time limit of --timeout")
    assert found["diverging", "mSAC"] == ("diverged", "a loss is not finite")
    before = sorted(path.stat().st_mtime_ns for path in tmp_path.glob("run/cells/*/status.json"))
    assert run("hanging, diverging", *limit).returncode == 1
    assert sorted(path.stat().st_mtime_ns for path in tmp_path.glob("run/cells/*/status.json")) == before
    run("hanging, diverging", *limit, "--retry-failed", "--only", "backend=diverging")
    after = sorted(path.stat().st_mtime_ns for path in tmp_path.glob("run/cells/*/status.json"))
    assert len(set(after) & set(before)) == 1


def _leave(link: object) -> None:
    """A process that has done its work."""


def test_a_cell_that_ended_as_its_time_did_keeps_its_result(
    finished_run: Path, tiny_suite: Path, tmp_path: Path
) -> None:
    run = RunFolder(tmp_path / "run")
    shutil.copytree(finished_run, run.path)
    (cell, *_) = make_plan(load_suite(tiny_suite, installed()), "smoke", installed()).cells
    before = run.status(cell)
    settle(cell, start("spawn", _leave), run, Status("timeout", "too late"))
    assert run.status(cell) == before
    assert before.state == "done"


def _stopped_by_others(link: object, mark: str, until: int) -> None:
    """A process that SIGTERM ends as often as `until`, and that then does its work."""
    with open(mark, "a") as file:
        file.write(".")
        times = file.tell()
    os._exit(STOPPED if times <= until else 0)


@pytest.mark.parametrize(
    ("until", "times", "reason"),
    [(1, 2, "its process exited with code 0; see log.txt"), (9, 3, "others have stopped its process 3 times")],
)
def test_a_cell_whose_process_others_stop_goes_on_but_not_for_ever(
    until: int, times: int, reason: str, tiny_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, mark = RunFolder(tmp_path / "run"), tmp_path / "mark"
    (cell, *_) = make_plan(load_suite(tiny_suite, installed()), "smoke", installed()).cells
    monkeypatch.setattr(processes, "RESTARTS", 2)
    monkeypatch.setattr(
        processes, "start_cell", lambda *arguments: start("spawn", _stopped_by_others, str(mark), until)
    )
    executor = Processes(run, lambda cell, progress: None, Keeping(), 1)
    executor.start(cell)
    ended: list[object] = []
    while not ended:
        ended = [*executor.ended()]
    assert len(mark.read_text()) == times
    assert run.status(cell).reason == reason


def _closes_all_files(link: object) -> None:
    """A simulator that closes every file of its process, the link among them, and lives on."""
    os.closerange(0, 4096)
    threading.Event().wait()


def test_a_cell_that_closes_its_link_and_lives_on_is_ended(
    tiny_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = RunFolder(tmp_path / "run")
    (cell, *_) = make_plan(load_suite(tiny_suite, installed()), "smoke", installed()).cells
    monkeypatch.setattr("causalbench.processes.LEAVING", 0.1)
    monkeypatch.setattr(processes, "start_cell", lambda *arguments: start("spawn", _closes_all_files))
    executor = Processes(run, lambda cell, progress: None, Keeping(), 1)
    executor.start(cell)
    ended: list[object] = []
    while not ended:
        ended = [*executor.ended()]
    assert run.status(cell) == Status("failed", "its process was killed by SIGKILL; see log.txt")


def test_the_serial_executor_goes_on_after_an_exception(run: Callable, tmp_path: Path) -> None:
    assert run("raising, leaving", "--executor", "serial").returncode == 1
    found = reasons(tmp_path / "run")
    assert found["raising", "mSAC"] == ("failed", "RuntimeError: the arm fell off")
    assert found["leaving", "mSAC"] == ("failed", "SystemExit: 0")
    assert found["raising", "cmSAC"][0] == "skipped"


def test_the_log_of_a_chatty_simulator_keeps_its_beginning_and_its_end(run: Callable, tmp_path: Path) -> None:
    run("chatty", "--only", "method=mSAC")
    (log,) = tmp_path.glob("run/cells/*/log.txt")
    text = log.read_text()
    assert len(text) < LIMIT + 1000
    assert text.startswith("noise\nnoise\n")
    assert "bytes are left out here" in text
    assert "RuntimeError: the last word" in text[-1000:]


def test_a_log_that_is_being_written_is_cut_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell_log, "LIMIT", 20)
    monkeypatch.setattr(cell_log, "LIMIT_WHILE_WRITTEN", 80)
    path = tmp_path / "log.txt"
    with path.open("ab", buffering=0) as log:
        log.write(b"0123456789" * 8)
        cell_log.cut(path)
        assert len(path.read_bytes()) == 80
        log.write(b"x")
        cell_log.cut(path)
        log.write(b"y")
    assert path.read_bytes() == b"0123456789y"
    cell_log.shorten(path)
    assert path.read_bytes() == b"0123456789y"
    path.write_bytes(b"a" * 10 + b"b" * 100 + b"c" * 10)
    cell_log.shorten(path)
    assert path.read_bytes() == b"a" * 10 + b"\n[100 bytes are left out here]\n" + b"c" * 10


def test_cells_start_in_order_as_cores_and_discoveries_allow(tiny_suite: Path) -> None:
    text = tiny_suite.read_text().replace("seeds: 1", "seeds: 2, graphs: per_seed")
    suite = tiny_suite.with_name("two.yaml")
    suite.write_text(text)
    cells = make_plan(load_suite(suite, installed()), "smoke", installed()).cells
    first, second = (cell for cell in cells if isinstance(cell, DiscoveryCell))
    plain = [cell for cell in cells if isinstance(cell, LearnerCell) and cell.discovery is None]
    causal = [cell for cell in cells if isinstance(cell, LearnerCell) and cell.discovery is not None]
    queue = Queue(cells)
    assert [queue.next(3, 3), queue.next(1, 3), queue.next(0, 3)] == [first, plain[0], None]
    queue.ended(first)
    assert [queue.next(1, 3), queue.next(1, 3), queue.next(1, 3)] == [plain[1], causal[0], None]
    assert queue.next(2, 3) == second
    queue.ended(second)
    assert [queue.next(1, 1), queue.next(1, 1)] == [causal[1], None]


def test_the_fork_server_never_imports_a_simulator() -> None:
    code = f"import sys, importlib; [importlib.import_module(m) for m in {PRELOAD!r}]; print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "torch" in modules
    assert {"mujoco", "gymnasium_robotics", "robosuite", "pybullet"}.isdisjoint(modules)
