"""Hypotheses are written down once, before any cell; what is added or changed later is known as such."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from stored import finished

from causalbench.errors import DamagedFileError
from causalbench.store.run_folder import RunFolder
from causalbench.store.statements import HYPOTHESES, Stated, merged_statements, read_statements
from causalbench.suite.hypotheses import Statement

FIRST = Statement("s", "quick", ("A > B",), ("x", "y"), (100, 101))
LATER = replace(FIRST, hypotheses=("B > A",))


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    (tmp_path / "run").mkdir()
    return RunFolder(tmp_path / "run")


def test_the_first_statement_stands_and_later_ones_are_exploratory(run: RunFolder) -> None:
    run.state(FIRST)
    before = (run.path / HYPOTHESES).read_bytes()
    finished(run)
    run.state(FIRST)
    assert (run.path / HYPOTHESES).read_bytes() == before
    run.state(LATER)
    run.state(replace(FIRST, seeds=(100, 101, 102)))  # more seeds after a look
    assert [(s.statement.hypotheses, s.before_any_cell) for s in run.stated()] == [
        (("A > B",), True), (("B > A",), False), (("A > B",), False),
    ]  # fmt: skip


@pytest.mark.parametrize("with_cells", [True, False])
def test_only_the_first_statement_of_a_folder_without_cells_counts(run: RunFolder, with_cells: bool) -> None:
    if with_cells:
        finished(run)
    run.state(FIRST)
    run.state(LATER)
    assert [s.before_any_cell for s in run.stated()] == [not with_cells, False]


@pytest.mark.parametrize(("old", "new"), [("A > B", "B > A"), ("A > B", "A < B"), ('"quick"', "3"), ("{", "")])
def test_a_changed_file_is_said_to_be_damaged_and_put_aside(run: RunFolder, old: str, new: str) -> None:
    run.state(FIRST)
    path = run.path / HYPOTHESES
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(DamagedFileError, match=HYPOTHESES):
        read_statements(run.path)
    assert run.stated() == ()
    assert len(run.problems()) == 1
    finished(run)
    run.state(FIRST)
    assert [s.before_any_cell for s in run.stated()] == [False]
    assert path.with_suffix(".damaged.json").exists()


def test_a_hash_is_of_all_that_is_stated(run: RunFolder) -> None:
    run.state(FIRST)
    (entry,) = json.loads((run.path / HYPOTHESES).read_text())["statements"]
    assert entry["hash"] == FIRST.hash
    changed = [LATER, replace(FIRST, tier="full"), replace(FIRST, seeds=(100,)), replace(FIRST, backends=("x",))]
    assert len({FIRST.hash, *(other.hash for other in changed)}) == 5


def test_runs_together_have_stated_what_each_of_them_began_with() -> None:
    first, later = Stated(FIRST, True), Stated(LATER, False)
    assert merged_statements([[first], [first, later]]) == (first, later)
    assert merged_statements([[first], [Stated(LATER, True)]]) == (Stated(FIRST, False), later)
    assert merged_statements([[first], []]) == (Stated(FIRST, False),)
