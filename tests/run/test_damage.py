"""Damaged files of a run: each command says so in a sentence, keeps the rest, and `run` makes the results again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from runs import results

from causalbench import formats
from causalbench.cli.app import app
from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.run.cell import Keeping, run_cell
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import LearnerCell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished_run, tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture
def call(tiny_suite: Path, run: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, str]]:
    """A function that calls a command in this process: its exit code, or the sentence of its mistake, and stderr."""

    def call(name: str, *more: str) -> tuple[Any, str]:
        capsys.readouterr()
        suite = [str(tiny_suite), "--tier", "smoke", "--out"] if name in ("run", "plan") else []
        try:
            code = app([name, *suite, str(run), *more], standalone_mode=False)
        except UserError as error:
            code = str(error)
        return code, capsys.readouterr().err

    return call


def rerun(call: Callable[..., tuple[Any, str]]) -> int:
    """Run again, in this process; how many cells that took."""
    code, text = call("run", "--executor", "serial")
    assert code in (None, 0), text
    return int(text.partition(" of 3 cells to run")[0].rpartition("\n")[2])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:100])


def without_last_line(path: Path) -> None:
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))


@pytest.mark.parametrize(
    ("file", "damage"),
    [
        ("cells/*-cmSAC-*/cell.json", emptied),
        ("cells/*-cmSAC-*/cell.json", cut),
        ("cells/*-cmSAC-*/status.json", emptied),
        ("cells/*-cmSAC-*/status.json", lambda path: path.write_text(f'{{"schema": {formats.CELL}, "state": "done"}}')),
        ("cells/*-cmSAC-*/progress.csv", Path.unlink),
        ("cells/*-cmSAC-*/counts.json", emptied),
        ("cells/*-cmSAC-*/policy/policy.safetensors", cut),
        ("cells/*-cmSAC-*/policy/policy.json", emptied),
        ("discovery/*/graph.json", cut),
        ("environment.json", emptied),
        ("run.json", emptied),
        ("results.csv", emptied),
    ],
)
def test_commands_that_only_read_say_what_is_damaged_and_go_on(
    file: str, damage: Callable[[Path], Any], run: Path, call: Callable[..., tuple[Any, str]]
) -> None:
    (path,) = run.glob(file)
    damage(path)
    for command in (("leaderboard",), ("plan",), ("play", "--only", "seed=7")):
        code, text = call(*command)
        assert code in (None, 0) or "no finished policy here" in code
        if path.name not in ("results.csv", "run.json"):
            assert f"not counted: {run}" in text
            assert path.name in text


def test_what_is_published_without_policies_counts_as_before(
    finished_run: Path, run: Path, call: Callable[..., tuple[Any, str]]
) -> None:
    for folder in [*run.glob("cells/*/policy"), *run.glob("discovery/*/data")]:
        shutil.rmtree(folder)
    assert rerun(call) == 0
    left = results(run)
    assert left == {name: content for name, content in results(finished_run).items() if name in left}
    assert (run / "results.csv").read_bytes() == (finished_run / "results.csv").read_bytes()
    code, text = call("play")
    assert "published without its policy" in code
    assert text == ""


def test_a_policy_that_is_damaged_is_not_filmed(run: Path, call: Callable[..., tuple[Any, str]]) -> None:
    cut(next(run.glob("cells/*-cmSAC-*/policy/policy.safetensors")))
    code, text = call("play", "--only", "method=cmSAC")
    assert "no finished policy here" in code
    assert "policy.safetensors: not the file that was written" in text


@pytest.mark.parametrize(
    ("file", "damage", "cells"),
    [
        ("cells/*-mSAC-*/progress.csv", without_last_line, 1),
        pytest.param("cells/*-mSAC-*/cell.json", emptied, 1, marks=pytest.mark.long),
        pytest.param("discovery/*/oracle.csv", without_last_line, 1, marks=pytest.mark.long),
    ],
)
def test_a_damaged_cell_is_run_again_and_the_results_are_the_same(
    file: str, damage: Callable[[Path], None], cells: int, finished_run: Path, run: Path,
    call: Callable[..., tuple[Any, str]],
) -> None:  # fmt: skip
    damage(next(run.glob(file)))
    assert rerun(call) == cells
    assert results(run) == results(finished_run)
    assert rerun(call) == 0


def test_copies_of_cells_are_no_seeds(run: Path, call: Callable[..., tuple[Any, str]]) -> None:
    for cell in [*run.glob("cells/*")]:
        for number in range(1, 5):
            shutil.copytree(cell, cell.with_name(f"{cell.name}.backup{number}"))
    before = (run / "leaderboard.csv").read_bytes()
    code, text = call("run", "--executor", "serial")
    assert code in (None, 0)
    assert (run / "leaderboard.csv").read_bytes() == before
    assert text.count("a copy of the cell") == 8


def test_damaged_samples_of_an_unfinished_discovery_are_collected_again(
    finished_run: Path, run: Path, call: Callable[..., tuple[Any, str]]
) -> None:
    (folder,) = run.glob("discovery/*")
    path = folder / "data" / "stage1-random.npz"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))
    status = json.loads((folder / "status.json").read_text())
    (folder / "status.json").write_text(json.dumps(status | {"state": "running", "files": {}}))
    assert rerun(call) == 1
    assert results(run) == results(finished_run)
    assert "stage1-random.npz: its SHA-256 is not that of the samples" in (folder / "log.txt").read_text()


@pytest.mark.parametrize("damage", [emptied, cut, lambda path: path.write_bytes(path.read_bytes()[:-1] + b"\xff")])
def test_a_damaged_checkpoint_makes_the_cell_start_over_and_its_log_say_so(
    damage: Callable[[Path], None], finished_run: Path, tiny_suite: Path, tmp_path: Path
) -> None:
    run = RunFolder(tmp_path / "run")
    plan = make_plan(load_suite(tiny_suite, installed()), "smoke", installed(), only=["method=mSAC"])
    (cell,) = (cell for cell in plan.cells if isinstance(cell, LearnerCell))
    folder = run.start(cell)

    def killed(progress: Any) -> None:
        if (folder / "checkpoint.safetensors").exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_cell(cell, run, killed, Keeping(checkpoint_every=20))
    damage(folder / "checkpoint.safetensors")
    run.start(cell)
    assert run_cell(cell, run, lambda progress: None, Keeping(checkpoint_every=20)).state == "done"
    assert "checkpoint.safetensors: not a checkpoint of causalbench, or damaged" in (folder / "log.txt").read_text()
    assert "the cell starts over" in (folder / "log.txt").read_text()
    assert run.stored(cell).status.files == RunFolder(finished_run).stored(cell).status.files
