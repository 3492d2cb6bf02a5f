"""How a run stands, as another process sees it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from causalbench.errors import RunFolderError
from causalbench.run.watch import run_status
from causalbench.store.cell_progress import PROGRESS, CellProgress, ProgressFile, read_cell_progress
from causalbench.store.cells import Status, StoredCell
from causalbench.store.run_folder import RunFolder


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> RunFolder:
    return RunFolder(Path(shutil.copytree(finished_run, tmp_path / "run")))


def unfinished(run: RunFolder, state: str, reason: str = "") -> StoredCell:
    """The cell of mSAC, which now stands in `state`."""
    (cell,) = [cell for cell in run.cells() if cell.method == "mSAC"]
    run.finish(cell, Status(state, reason))  # type: ignore[arg-type]
    return cell


def test_a_finished_run_is_held_by_nobody(run: RunFolder) -> None:
    found = run_status(run)
    assert (found.planned, found.states, found.fraction) == (3, {"done": 3}, 1.0)
    assert (found.holder, found.left, found.running, found.failures) == (None, None, [], [])


def test_what_runs_is_seen_with_its_share_and_the_time_that_is_left(run: RunFolder) -> None:
    cell = unfinished(run, "running")
    (cell.folder / PROGRESS).write_text(json.dumps({"fraction": 0.6, "seconds": 20.0, "began_at": 0.1, "text": "on"}))
    with run.claim():
        found = run_status(run)
    assert found.holder is not None
    assert found.holder.pid == os.getpid()
    (running,) = found.running
    assert (running.method, running.fraction, running.text) == ("mSAC", 0.6, "on")
    assert running.left == found.left == pytest.approx(16.0)  # half took 20 s, four tenths are left
    assert found.fraction == pytest.approx(2.6 / 3)
    assert run_status(run).left is None  # interrupted: nobody works on it


def test_cells_that_wait_take_as_long_as_those_that_are_done(run: RunFolder) -> None:
    run.add_session({"cells": 7})
    mean = sum(cell.status.seconds for cell in run.cells()) / 3
    with run.claim():
        found = run_status(run)
    assert (found.planned, found.states) == (7, {"done": 3, "pending": 4})
    assert found.left == pytest.approx(4 * mean)


@pytest.mark.parametrize(
    "content", ["", "{", '{"fraction": 7, "seconds": 1, "began_at": 0}', '{"fraction": "x"}', "[]"]
)
def test_progress_that_is_none_is_left_out(content: str, tmp_path: Path) -> None:
    (tmp_path / PROGRESS).write_text(content)
    assert read_cell_progress(tmp_path) is None


def test_progress_is_written_now_and_then_and_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [50.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    kept = ProgressFile(tmp_path)
    kept.write(0.25, "stage 1")
    now[0] = 51.0
    kept.write(0.3, "stage 1")
    assert read_cell_progress(tmp_path) is None
    now[0] = 60.0
    kept.write(0.5, "stage 2")
    found = read_cell_progress(tmp_path)
    assert found == CellProgress(0.5, 10.0, 0.25, "stage 2")
    assert found.left == 20.0
    kept.close()
    assert [*tmp_path.iterdir()] == []
    shutil.rmtree(tmp_path)
    now[0] = 99.0
    kept.write(0.9, "stage 2")  # a folder that is gone ends no cell


def test_the_command_says_it_plainly_without_a_terminal(run: RunFolder, command: list[str]) -> None:
    cell = unfinished(run, "failed", "the arm \x1b[31mfell\x1b[0m off")
    plain = os.environ | {"NO_COLOR": "1", "COLUMNS": "40", "LANG": "C", "LC_ALL": "C"}
    done = subprocess.run([*command, "status", str(run.path)], env=plain, capture_output=True)
    lines = done.stdout.decode("ascii").splitlines()
    assert lines == [
        f"{run.path}: 67% of 3 cells (2 done, 1 failed)",
        "  nobody works on it; `causalbench run` goes on with it",
        f"  {cell.id} failed: the arm \\x1b[31mfell\\x1b[0m off",
        f"    cells/{cell.id}/log.txt",
    ]


def test_json_has_all_of_it_and_a_folder_that_is_no_run_is_refused(run: RunFolder, cli: Callable) -> None:
    unfinished(run, "failed", "no")
    found = json.loads(cli("status", run.path, "--json").stdout)
    assert (found["planned"], found["states"]) == (3, {"done": 2, "failed": 1})
    assert [failure["reason"] for failure in found["failures"]] == ["no"]
    with pytest.raises(RunFolderError, match="no run here"):
        run_status(RunFolder(run.path / "cells"))
