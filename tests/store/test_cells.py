"""The run folder: atomic writes, states, and what may not be mixed."""

from __future__ import annotations

import copy
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causalbench import atomic as files
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.errors import RunFolderError
from causalbench.store.cells import PENDING, RunFolder, Status, check_comparable
from causalbench.store.records import read_counts, read_progress, write_counts, write_progress


@dataclass
class FakeCell:
    id: str
    identity: dict[str, Any]


LEARNER: dict[str, Any] = {
    "kind": "learner", "code": "1", "task": {"name": "t", "version": 0}, "backend": {"name": "b", "version": "1"},
    "method": {"name": "m"}, "seed": 0, "env_steps": 100, "learner": {"gamma": 0.9}, "evaluation": {"every": 10},
}  # fmt: skip


def test_a_write_that_is_cut_short_leaves_the_old_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "status.json"
    files.write_text(path, "old")

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", die)
    with pytest.raises(KeyboardInterrupt):
        files.write_text(path, "new")
    assert path.read_text() == "old"


def test_a_folder_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    def fill(folder: Path) -> None:
        (folder / "a").write_text("1")
        assert not (tmp_path / "policy").exists()

    files.write_folder(tmp_path / "policy", fill)
    files.write_folder(tmp_path / "policy", lambda folder: (folder / "b").touch())
    assert [p.name for p in (tmp_path / "policy").iterdir()] == ["b"]


def test_a_cell_goes_from_pending_to_running_to_done(tmp_path: Path) -> None:
    run, cell = RunFolder(tmp_path), FakeCell("m-s0-abc", LEARNER)
    assert run.status(cell) == PENDING
    (run.start(cell) / "leftover").touch()
    assert run.status(cell).state == "running"
    run.start(cell)
    assert not (run.folder(cell) / "leftover").exists()
    run.finish(cell, Status("done", "", 1.5, 100))
    stored = run.cells()
    assert [(c.id, c.status) for c in stored] == [("m-s0-abc", Status("done", "", 1.5, 100))]
    assert stored[0].identity == LEARNER


def test_a_skipped_cell_that_never_started_has_a_folder(tmp_path: Path) -> None:
    run, cell = RunFolder(tmp_path), FakeCell("x", LEARNER)
    run.finish(cell, Status("skipped", "no graph"))
    assert [c.status.reason for c in run.cells()] == ["no graph"]


def test_a_folder_is_for_one_command_at_a_time(tmp_path: Path) -> None:
    with RunFolder(tmp_path).claim(), pytest.raises(RunFolderError, match="another command is running here"):
        RunFolder(tmp_path).claim()
    RunFolder(tmp_path).claim().close()


def test_a_folder_that_cannot_be_written_is_the_users_mistake(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunFolderError, match=r"file: cannot be written \(Not a directory\); choose another with --out"):
        RunFolder(tmp_path / "file").claim()


def test_another_schema_is_refused(tmp_path: Path) -> None:
    run, cell = RunFolder(tmp_path), FakeCell("x", LEARNER)
    path = run.start(cell) / "cell.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99}))
    with pytest.raises(RunFolderError, match="written by another version of causalbench"):
        run.cells()


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("env_steps", 200, "the budget is {'env_steps': 200} and {'env_steps': 100}"),
        ("task", {"name": "t", "version": 1}, "the task is {'version': 1} and {'version': 0}"),
        ("learner", {"gamma": 0.5}, "the learner of m on b is {'gamma': 0.5} and {'gamma': 0.9}"),
        ("backend", {"name": "b", "version": "2"}, "backend b is {'version': '2'} and {'version': '1'}"),
        ("code", "2", "causalbench's version is '2' and '1'"),
    ],
)
def test_cells_that_cannot_be_compared_are_refused_by_name(key: str, value: object, message: str) -> None:
    other = copy.deepcopy(LEARNER) | {key: value}
    with pytest.raises(RunFolderError) as caught:
        check_comparable([("one", LEARNER), ("two", other)])
    assert str(caught.value).startswith(f"two and one cannot be compared: {message}; ")


def test_cells_that_differ_in_seed_method_or_backend_are_compared() -> None:
    others = [
        {"seed": 5},
        {"method": {"name": "n"}, "learner": {"gamma": 0.1}},
        {"backend": {"name": "c", "version": "7"}, "evaluation": {"every": 3}},
    ]
    check_comparable([("one", LEARNER), *(("other", LEARNER | other) for other in others)])


def test_evaluations_and_counts_come_back_bit_for_bit(tmp_path: Path) -> None:
    evaluations = [
        Evaluation(10, 3, 1 / 3, 0.1 + 0.2, None, 0.0, 1.5, 7.0, {"r_a": -1e-17, "r_b": 2.0}),
        Evaluation(20, 3, 1.0, 2 / 3, 0.5, 1.0, 4.0, 9.0, {"r_a": 3.0, "r_b": float(np.float32(0.1))}),
    ]
    write_progress(tmp_path / "progress.csv", evaluations)
    assert read_progress(tmp_path / "progress.csv") == evaluations
    table = np.zeros((3, 3), dtype=np.int64)
    table[1, 2], table[2, 1] = 4, 1
    write_counts(tmp_path / "counts.json", TrainingCounts(table, 20, 2, reversals=1, reached={1: 2, 2: 1}), None)
    counts = read_counts(tmp_path / "counts.json")
    assert [tuple(row) for row in counts.transitions] == [(1, 2, 4), (2, 1, 1)]
    assert (counts.env_steps, counts.reversals, counts.graph, counts.reached) == (20, 1, "", {"1": 2, "2": 1})
