"""`hypotheses.json` of a run folder: what its runs set out to show, written down before their cells start."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from causalbench import formats
from causalbench.atomic import write_json
from causalbench.errors import DamagedFileError
from causalbench.store.files import read_json, validated
from causalbench.suite.hypotheses import Hypothesis, Statement

HYPOTHESES = "hypotheses.json"


@dataclass(frozen=True)
class Stated:
    """A statement, and whether it stood there before any cell: one that was made later is exploratory."""

    statement: Statement
    before_any_cell: bool


@dataclass(frozen=True)
class _Entry(Stated):
    hash: str


@dataclass(frozen=True)
class _File:
    statements: Sequence[_Entry]


def add_statement(folder: Path, statement: Statement, before_any_cell: bool) -> None:
    """Write `statement` down in the run folder unless it stands there; a damaged file is put aside."""
    path = folder / HYPOTHESES
    try:
        found = read_statements(folder)
    except DamagedFileError:
        os.replace(path, path.with_suffix(".damaged.json"))
        found = ()
    if statement in (entry.statement for entry in found):
        return
    entries = [*found, Stated(statement, before_any_cell and not found)]
    content = [asdict(entry) | {"hash": entry.statement.hash} for entry in entries]
    write_json(path, {"schema": formats.RUN, "statements": content})


def read_statements(folder: Path) -> tuple[Stated, ...]:
    """The statements of a run folder in the order in which they were made; empty where none was.

    Raises `DamagedFileError` for a file that is not as it was written.
    """
    path = folder / HYPOTHESES
    if not path.exists() and not path.is_symlink():
        return ()
    content = read_json(path)
    if content.get("schema") != formats.RUN:
        raise DamagedFileError(f"{path}: schema {content.get('schema')!r}, expected {formats.RUN}")
    entries = validated(path, _File, content).statements
    for entry in entries:
        _check(path, entry)
    return tuple(Stated(entry.statement, entry.before_any_cell) for entry in entries)


def _check(path: Path, entry: _Entry) -> None:
    if entry.hash != entry.statement.hash:
        raise DamagedFileError(f"{path}: not the hypotheses that were written, their hash differs")
    try:
        for text in entry.statement.hypotheses:
            Hypothesis.parse(text)
    except ValueError as error:
        raise DamagedFileError(f"{path}: {error}") from None


def merged_statements(runs: Iterable[Sequence[Stated]]) -> tuple[Stated, ...]:
    """The statements of several run folders, each once; one that not all of them began with is exploratory."""
    each = [list(run) for run in runs]
    found: dict[Statement, bool] = {}
    for entry in (entry for run in each for entry in run):
        found[entry.statement] = all(Stated(entry.statement, True) in run for run in each)
    return tuple(Stated(statement, before) for statement, before in found.items())
