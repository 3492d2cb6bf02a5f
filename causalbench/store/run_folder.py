"""One run's folder: what lies where, and the only way to read and write it."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from causalbench import formats
from causalbench.atomic import remove, replacing, sweep, write_json
from causalbench.errors import DamagedFileError
from causalbench.store.budgets import is_outgrown, largest_budgets
from causalbench.store.cells import (
    CELL,
    CHECKPOINT,
    DATA,
    KINDS,
    LOG,
    PENDING,
    STATUS,
    Status,
    StoredCell,
    in_order,
    read_cell,
    result_digests,
)
from causalbench.store.claim import claim, own_folder
from causalbench.store.files import is_file, is_folder, read_json, validated
from causalbench.store.statements import Stated, add_statement, read_statements
from causalbench.suite.hypotheses import Statement

ENVIRONMENT, SUITE = "environment.json", "suite.yaml"


class Identified(Protocol):
    """What the store needs to know of a cell."""

    @property
    def id(self) -> str:
        """Its folder's name."""

    @property
    def identity(self) -> dict[str, Any]:
        """What its id is a hash of; "kind" says which folder it belongs to."""


@dataclass(frozen=True)
class _Session:
    known_gaps: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Environment:
    sessions: Sequence[_Session]


class RunFolder:
    """One run's folder. Times stand only in `status.json`, `timing.csv`, `environment.json` and `log.txt`."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @contextmanager
    def claim(self) -> Iterator[None]:
        """Make the folder and hold it, alone, until the block ends; what a killed command was writing is swept away.

        Raises `RunFolderError`, see `store.claim.claim`.
        """
        with claim(self.path, "run", known=any(isinstance(found, StoredCell) for found in self._read())):
            for name in KINDS.values():
                own_folder(self.path / name)
            for folder in self._folders():
                for place in filter(is_folder, (folder, folder / DATA)):
                    sweep(place)
            yield

    def folder(self, cell: Identified) -> Path:
        """Where `cell` lies or will lie."""
        return self.path / KINDS[cell.identity["kind"]] / cell.id

    def start(self, cell: Identified) -> Path:
        """A folder for `cell`, marked as running; of an earlier attempt only what it continues from stays.

        That is a discovery cell's samples, and a learner cell's checkpoint with the log up to it.
        """
        folder = self._clear(cell)
        self.finish(cell, Status("running"))
        return folder

    def begin_with(self, cell: Identified, checkpoint: Path) -> None:
        """Let `cell`, which has yet to start, continue from the checkpoint of another cell."""
        with replacing(self._clear(cell) / CHECKPOINT) as temporary:
            try:
                os.link(checkpoint, temporary)  # costs no room; checkpoints are replaced, never written into
            except OSError:  # not every file system has links
                shutil.copyfile(checkpoint, temporary)

    def _clear(self, cell: Identified) -> Path:
        """The folder of `cell` with nothing in it but what it continues from, and what says that it is this cell."""
        folder = self.folder(cell)
        if not is_folder(folder):
            remove(folder)  # a link, perhaps, which is never entered
            folder.mkdir(parents=True)
        keep = {DATA} if is_folder(folder / DATA) else set()
        if is_file(folder / CHECKPOINT):
            keep |= {name for name in (CHECKPOINT, LOG) if is_file(folder / name)}
        for path in [*folder.iterdir()]:
            if path.name not in keep:
                remove(path)
        write_json(folder / CELL, {"schema": formats.CELL, "id": cell.id} | cell.identity)
        return folder

    def finish(self, cell: Identified, status: Status) -> None:
        """Record `status`; for a cell that is done this is its last write. Raises `OSError` if this folder is gone."""
        folder = self.folder(cell)
        os.stat(self.path)  # what somebody has removed is not made anew
        if not is_file(folder / CELL):  # a cell that was skipped never started
            self._clear(cell)
        if status.state == "done":
            status = dataclasses.replace(status, files=result_digests(folder))
        write_json(folder / STATUS, {"schema": formats.CELL} | dataclasses.asdict(status))

    def stored(self, cell: Identified) -> StoredCell:
        """`cell` as it lies here. Raises `DamagedFileError` when it is not here or cannot be read."""
        return read_cell(self.folder(cell))

    def status(self, cell: Identified) -> Status:
        """How `cell` stands; pending if it was never started."""
        folder = self.folder(cell)
        if not folder.exists() and not folder.is_symlink():
            return PENDING
        try:
            return self.stored(cell).status
        except DamagedFileError as error:
            return Status("damaged", str(error))

    def cells(self) -> list[StoredCell]:
        """The cells that count, in an order that does not depend on when each was run.

        Those are all of which can be told what they are, but of learners on a backend only those of the largest budget.
        """
        found = self.every_cell()
        largest = largest_budgets(cell.identity for cell in found)
        return [cell for cell in found if not is_outgrown(cell.identity, largest)]

    def every_cell(self) -> list[StoredCell]:
        """Every cell of which can be told what it is, in the order of `cells`, those of smaller budgets too."""
        return in_order(found for found in self._read() if isinstance(found, StoredCell))

    def problems(self) -> list[str]:
        """A sentence for everything here that is damaged, and so is not counted."""
        found = list(self._read())
        sentences = [str(error) for error in found if isinstance(error, DamagedFileError)]
        sentences += [c.status.reason for c in found if isinstance(c, StoredCell) and c.status.state == "damaged"]
        for read, lost in ((self._environment, "earlier sessions"), (self._statements, "hypotheses")):
            try:
                read()
            except DamagedFileError as error:
                sentences.append(f"{error}; what it said of {lost} is not known")
        return sentences

    def _read(self) -> Iterator[StoredCell | DamagedFileError]:
        for folder in self._folders():
            try:
                yield read_cell(folder)
            except DamagedFileError as error:
                yield error

    def _folders(self) -> list[Path]:
        """The folders of cells, and what else lies between them; hidden folders and plain files are none."""
        kinds = (self.path / kind for kind in KINDS.values())
        found = (path for kind in kinds if is_folder(kind) for path in sorted(kind.iterdir()))
        return [path for path in found if path.is_dir() and not path.name.startswith(".")]

    def suite_text(self) -> str:
        """The suite file as it was run, whatever bytes are in it; "" if there is none."""
        path = self.path / SUITE
        return path.read_text(encoding="utf-8", errors="replace") if is_file(path) else ""

    def sessions(self) -> list[dict[str, Any]]:
        """What `environment.json` says of each command that ran cells here; empty before the first, or if damaged."""
        try:
            return list(self._environment())
        except DamagedFileError:
            return []

    def add_session(self, session: Mapping[str, Any]) -> None:
        """Add to `environment.json`; a damaged one is put aside."""
        path = self.path / ENVIRONMENT
        try:
            sessions = self._environment()
        except DamagedFileError:
            os.replace(path, path.with_suffix(".damaged.json"))
            sessions = []
        write_json(path, {"schema": formats.RUN, "sessions": [*sessions, session]})

    def _environment(self) -> list[dict[str, Any]]:
        path = self.path / ENVIRONMENT
        if not path.exists() and not path.is_symlink():
            return []
        content = read_json(path)
        if content.get("schema") != formats.RUN:
            raise DamagedFileError(f"{path}: schema {content.get('schema')!r}, expected {formats.RUN}")
        validated(path, _Environment, content)
        sessions: list[dict[str, Any]] = content["sessions"]
        return sessions

    def state(self, statement: Statement) -> None:
        """Write down what a run sets out to show; what is stated after the first cell has started is exploratory."""
        add_statement(self.path, statement, before_any_cell=not self._folders())

    def stated(self) -> tuple[Stated, ...]:
        """What runs in this folder set out to show; empty before the first, or if the file is damaged."""
        try:
            return self._statements()
        except DamagedFileError:
            return ()

    def _statements(self) -> tuple[Stated, ...]:
        return read_statements(self.path)

    def known_gaps(self) -> dict[str, dict[str, str]]:
        """Backend -> lines of the contract that it was known not to keep, with the reasons, in any session."""
        gaps: dict[str, dict[str, str]] = {}
        for session in self.sessions():
            for backend, reasons in session.get("known_gaps", {}).items():
                gaps.setdefault(backend, {}).update(reasons)
        return gaps
