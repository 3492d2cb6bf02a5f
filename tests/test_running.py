"""`causalbench.run_suite`: the command's run, from a script that knows nothing of processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from runs import results

import causalbench
from causalbench.errors import RunFolderError, UnfinishedRunError, UnknownNameError


def test_a_script_without_a_guard_gets_what_the_command_writes(
    tiny_suite: Path, finished_run: Path, tmp_path: Path
) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import causalbench\n"
        f"found = causalbench.run_suite({str(tiny_suite)!r}, 'smoke', 'run', jobs=2)\n"
        "print(sorted(found.results.method), list(found.timing.state))\n"
    )
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "['cmSAC', 'mSAC'] ['done', 'done', 'done']\n"
    assert results(tmp_path / "run") == results(finished_run)
    assert (tmp_path / "run" / "report.html").exists()


def test_a_cell_that_fails_is_an_error_that_names_it_and_the_others_stay(tiny_suite: Path, tmp_path: Path) -> None:
    suite = tmp_path / "suite.yaml"
    suite.write_text(tiny_suite.read_text().replace(", epsilon_cv: 1000, epsilon_direct: 0", ""))
    with pytest.raises(UnfinishedRunError, match=r"1 of 3 cells are not done: .*-cmSAC-.* failed: .*no action causes"):
        causalbench.run_suite(suite, "smoke", tmp_path / "run", executor="serial")
    assert list(causalbench.load_results(tmp_path / "run").results.method) == ["mSAC"]


def test_a_mistake_is_one_before_anything_runs(
    tiny_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownNameError, match=r"unknown suite 'pure_manp'\. Did you mean 'pure_manip'"):
        causalbench.run_suite("pure_manp")
    with pytest.raises(UnknownNameError, match="unknown tier 'big'"):
        causalbench.run_suite(tiny_suite, "big")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(RunFolderError, match="mine"):
        causalbench.run_suite(tiny_suite, "smoke", "mine")
    assert [path.name for path in tmp_path.rglob("*.*")] == ["letter.txt"]
