"""The run folder: states, and that what is not what was written is never counted, nor in the way of the rest."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from stored import LEARNER, PlannedCell, discovered, finished

from causalbench import formats
from causalbench.errors import DamagedFileError
from causalbench.store.cells import CELL, STATUS, Status, read_cell
from causalbench.store.run_folder import ENVIRONMENT, RunFolder


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    (tmp_path / "run").mkdir()
    return RunFolder(tmp_path / "run")


def test_a_cell_goes_from_pending_to_running_to_done(run: RunFolder) -> None:
    cell = PlannedCell(LEARNER)
    assert run.status(cell).state == "pending"
    (run.start(cell) / "leftover").touch()
    assert run.status(cell).state == "running"
    run.start(cell)
    assert not (run.folder(cell) / "leftover").exists()
    finished(run)
    (stored,) = run.cells()
    assert (stored.id, stored.identity) == (cell.id, LEARNER)
    assert (stored.kind, stored.task, stored.backend, stored.method, stored.seed) == ("learner", "t", "b", "m", 0)
    assert (stored.status.state, stored.status.seconds, stored.status.env_steps) == ("done", 1.5, 100)
    assert sorted(stored.status.files) == ["counts.json", "episodes.csv", "policy/policy.json", "progress.csv"]
    assert stored.evaluations()[-1].success_deterministic == 0.5
    assert stored.counts().env_steps == 100
    assert run.problems() == []


def test_a_skipped_cell_that_never_started_has_a_folder(run: RunFolder) -> None:
    run.finish(PlannedCell(LEARNER), Status("skipped", "no graph"))
    assert [c.status.reason for c in run.cells()] == ["no graph"]


def test_what_is_no_result_may_change(run: RunFolder) -> None:
    cell = discovered(run)
    for name in ("log.txt", "figures/matrix.svg", "data/stage1-random.npz"):
        (run.folder(cell) / name).parent.mkdir(exist_ok=True)
        (run.folder(cell) / name).write_text("later")
    assert run.status(cell).state == "done"
    assert run.stored(cell).graph().origin == "manual"
    assert run.stored(cell).effects() == {}


DAMAGES: dict[str, Callable[[Path], object]] = {
    "emptied": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-3]),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"x"),
    "missing": Path.unlink,
    "a folder": lambda path: (path.unlink(), path.mkdir()),
    "a link": lambda path: (path.rename(path.with_name("other")), path.symlink_to(path.with_name("other"))),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
}
FILES = ("cell.json", "status.json", "progress.csv", "episodes.csv", "counts.json", "policy/policy.json")


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_cell_is_named_left_out_and_run_again(run: RunFolder, file: str, damage: str) -> None:
    whole, cell = finished(run, seed=1), finished(run)
    DAMAGES[damage](run.folder(cell) / file)
    state = run.status(cell).state
    if file == "status.json" and damage == "missing":
        assert state == "pending"
    else:
        assert state == "damaged"
        assert str(run.folder(cell)) in "".join(run.problems())
    assert [c.id for c in run.cells() if c.status.state == "done"] == [whole.id]
    finished(run)
    assert run.status(cell).state == "done"
    assert run.problems() == []


@pytest.mark.parametrize("file", FILES)
def test_no_flipped_bit_goes_unnoticed_where_it_changes_a_result(run: RunFolder, file: str) -> None:
    """What may change without a word is what no result depends on: blanks of JSON, seconds, steps and reason."""
    cell, rng = finished(run), random.Random(3)
    path = run.folder(cell) / file
    content, before = path.read_bytes(), run.stored(cell)
    for _ in range(300):
        changed = bytearray(content)
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(changed))
        if run.status(cell).state == "done":
            after = run.stored(cell)
            assert (after.identity, after.status.files) == (before.identity, before.status.files)
            assert after.evaluations() == before.evaluations()


def test_a_copy_is_not_counted_and_named(run: RunFolder) -> None:
    cell = finished(run)
    for name in ("backup1", "copy of cell"):
        shutil.copytree(run.folder(cell), run.folder(cell).with_name(name))
    assert [c.id for c in run.cells()] == [cell.id]
    assert len(run.problems()) == 2
    assert all(f"a copy of the cell {cell.id}, which is not counted" in sentence for sentence in run.problems())


def test_a_cell_that_lies_among_the_other_kind_is_not_counted(run: RunFolder) -> None:
    cell = finished(run)
    (run.path / "discovery").mkdir()
    os.replace(run.folder(cell), run.path / "discovery" / cell.id)
    assert run.cells() == []


@pytest.mark.parametrize("key", sorted(LEARNER))
def test_a_changed_identity_is_not_that_of_the_id(run: RunFolder, key: str) -> None:
    """Whatever was changed by hand, also when id and folder's name go along."""
    cell = finished(run)
    path = run.folder(cell) / CELL
    content = json.loads(path.read_text())
    content[key] = {"seed": 1, "env_steps": 99, "kind": "discovery"}.get(key, (content[key] and [content[key]]) or 3)
    path.write_text(json.dumps(content))
    assert run.cells() == []
    assert len(run.problems()) == 1


def test_an_id_that_leads_elsewhere_is_refused(run: RunFolder, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    cell = PlannedCell(LEARNER | {"method": {"name": "../../../outside", "learner": "SAC"}})
    folder = run.path / "cells" / "x"
    folder.mkdir(parents=True)
    (folder / CELL).write_text(json.dumps({"schema": formats.CELL, "id": cell.id} | cell.identity))
    with pytest.raises(DamagedFileError, match=r"method\.name"):
        read_cell(folder)
    assert list(outside.iterdir()) == []


def test_digests_of_files_elsewhere_are_refused(run: RunFolder) -> None:
    cell = finished(run)
    path = run.folder(cell) / STATUS
    content = json.loads(path.read_text())
    for name in ("/etc/passwd", "../x", "policy/../../x"):
        path.write_text(json.dumps(content | {"files": content["files"] | {name: "0" * 64}}))
        assert "is no file of this folder" in run.status(cell).reason


def test_links_in_a_cell_are_neither_entered_nor_kept(run: RunFolder, tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "theirs").write_text("my own")
    cell = PlannedCell(LEARNER)
    folder = run.start(cell)
    for name in ("data", "checkpoint.safetensors", "log.txt", "policy"):
        (folder / name).symlink_to(outside)
    run.start(cell)
    assert sorted(path.name for path in folder.iterdir()) == [CELL, STATUS]
    shutil.rmtree(folder)
    folder.symlink_to(outside)
    assert run.status(cell).state == "damaged"
    run.start(cell)
    assert not folder.is_symlink()
    assert [path.name for path in outside.iterdir()] == ["theirs"]


def test_another_schema_is_named_and_not_counted(run: RunFolder) -> None:
    cell = finished(run)
    for name in (CELL, STATUS):
        path = run.folder(cell) / name
        content = path.read_text()
        path.write_text(json.dumps(json.loads(content) | {"schema": 99}))
        assert "schema 99" in run.status(cell).reason
        path.write_text(content)


def test_sessions_come_back_and_a_damaged_record_of_them_is_put_aside(run: RunFolder) -> None:
    run.add_session({"known_gaps": {"b": {"S1": "why"}}})
    run.add_session({"known_gaps": {"b": {"S2": "why not"}}, "command": ["x"]})
    assert len(run.sessions()) == 2
    assert run.known_gaps() == {"b": {"S1": "why", "S2": "why not"}}
    for damage in ('{"sessions": [', '{"schema": 2, "sessions": [{"known_gaps": 3}]}'):
        (run.path / ENVIRONMENT).write_text(damage)
        assert run.known_gaps() == {}
        assert "environment.json" in run.problems()[0]
    run.add_session({"command": ["y"]})
    assert run.sessions() == [{"command": ["y"]}]
    assert (run.path / "environment.damaged.json").read_text() == damage
