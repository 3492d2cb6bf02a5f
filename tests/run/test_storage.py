"""What a run says and keeps when its folder cannot be written: a full disk, a folder that was removed."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from runs import results

from causalbench import atomic
from causalbench.run import cell


@pytest.fixture
def run(tiny_suite: Path, cli: Callable, tmp_path: Path) -> Callable[[], Any]:
    """A function that runs mSAC of the tiny suite in the folder `run`."""
    suite = tmp_path / "suite.yaml"
    suite.write_text(tiny_suite.read_text().replace("cmSAC, mSAC", "mSAC").replace("seeds: 1", "seeds: 2"))
    return lambda: cli("run", str(suite), "--tier", "smoke", "--out", str(tmp_path / "run"), "--executor", "serial")


@pytest.mark.long
def test_a_full_disk_is_said_with_the_file_and_what_is_finished_stays(
    run: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Full in the middle of the second cell, then mended."""

    def fsync(file: int) -> None:
        if any((tmp_path / "run" / "cells").glob("*-s1-*/progress.csv")):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(atomic.os, "fsync", fsync)
        done = run()
    assert done.returncode == 1
    assert f"failed: {tmp_path / 'run'}/" in done.stderr
    assert (
        "No space left on device; finished cells are kept, and once that is mended the same command goes" in done.stderr
    )
    assert "Traceback" not in done.stderr
    first = {name: content for name, content in results(tmp_path / "run").items() if "-s0-" in name}
    assert any(name.endswith("policy.json") for name in first)
    again = run()
    assert again.returncode == 0
    assert "1 of 2 cells to run" in again.stderr
    assert {name: content for name, content in results(tmp_path / "run").items() if "-s0-" in name} == first


def test_a_folder_that_is_removed_in_mid_run_is_said_and_not_made_anew(
    run: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def remove(path: Path, evaluations: object) -> None:
        shutil.rmtree(tmp_path / "run")
        write(path, evaluations)  # type: ignore[arg-type]

    write = cell.write_progress
    monkeypatch.setattr(cell, "write_progress", remove)
    done = run()
    assert done.returncode == 1
    assert f"failed: {tmp_path / 'run'}: the folder was removed while its cells were running" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "run").exists()
