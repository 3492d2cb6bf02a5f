"""Cells on disk: `cells/<id>/` and `discovery/<id>/`, each whole once its `status.json` says so."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, Protocol, get_args

from causalbench.atomic import TEMPORARY, write_json
from causalbench.errors import RunFolderError

SCHEMA = 1
State = Literal["done", "failed", "timeout", "diverged", "skipped", "running", "pending"]
STATES: tuple[str, ...] = get_args(State)
DATA = "data"
"""The samples of a discovery cell: an unfinished one continues from those that are there."""
CHECKPOINT = "checkpoint.safetensors"
"""What an unfinished learner cell continues from."""
LOG = "log.txt"
ENVIRONMENT = "environment.json"
KINDS = {"learner": "cells", "discovery": "discovery"}
"""Kind of a cell -> the folder that such cells lie in."""


class Identified(Protocol):
    """What the store needs to know of a cell."""

    @property
    def id(self) -> str:
        """Its folder's name."""

    @property
    def identity(self) -> dict[str, Any]:
        """What its id is a hash of; "kind" says which folder it belongs to."""


@dataclass(frozen=True)
class Status:
    """How a cell stands. `reason` is a sentence unless it is done; `seconds` and `env_steps` are what it took."""

    state: State
    reason: str = ""
    seconds: float = 0.0
    env_steps: int = 0


PENDING = Status("pending")


@dataclass(frozen=True)
class StoredCell:
    """A cell as it lies on disk."""

    id: str
    identity: Mapping[str, Any]
    status: Status
    folder: Path

    @property
    def grid_point(self) -> str:
        """The settings of a suite's grid that made it, such as "learner.gamma=0.9"; "" without a grid."""
        return grid_text(self.identity)


class RunFolder:
    """One run's folder. Times stand only in `status.json`, `timing.csv`, `environment.json` and `log.txt`."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def claim(self) -> IO[str]:
        """Create the folder and lock it for as long as the returned file is open (a killed process lets go of it).

        Raises `RunFolderError` when it cannot be written or another command holds it.
        """
        try:
            for name in KINDS.values():
                (self.path / name).mkdir(parents=True, exist_ok=True)
            lock = (self.path / ".lock").open("w")
        except OSError as error:
            raise RunFolderError(
                f"{self.path}: cannot be written ({error.strerror}); choose another with --out"
            ) from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            lock.close()
            raise RunFolderError(
                f"{self.path}: another command is running here; wait or choose another --out"
            ) from error
        for half in [*self.path.rglob(TEMPORARY)]:  # what a killed command was writing
            shutil.rmtree(half) if half.is_dir() else half.unlink(missing_ok=True)
        return lock

    def folder(self, cell: Identified) -> Path:
        """Where `cell` lies or will lie."""
        return self.path / KINDS[cell.identity["kind"]] / cell.id

    def start(self, cell: Identified) -> Path:
        """A folder for `cell`, marked as running; of an earlier attempt only what it continues from stays.

        That is a discovery cell's samples, and a learner cell's checkpoint with the log up to it.
        """
        folder = self.folder(cell)
        folder.mkdir(parents=True, exist_ok=True)
        keep = {DATA} | ({CHECKPOINT, LOG} if (folder / CHECKPOINT).exists() else set())
        for path in folder.iterdir():
            if path.name in keep:
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        write_json(folder / "cell.json", {"schema": SCHEMA, "id": cell.id} | cell.identity)
        self.finish(cell, Status("running"))
        return folder

    def finish(self, cell: Identified, status: Status) -> None:
        """Record `status`; for a cell that is done this is its last write, and its checkpoint has served."""
        folder = self.folder(cell)
        if not folder.exists():  # a cell that was skipped never started
            folder.mkdir(parents=True)
            write_json(folder / "cell.json", {"schema": SCHEMA, "id": cell.id} | cell.identity)
        write_json(folder / "status.json", {"schema": SCHEMA} | dataclasses.asdict(status))
        if status.state == "done":
            (folder / CHECKPOINT).unlink(missing_ok=True)

    def status(self, cell: Identified) -> Status:
        """How `cell` stands; pending if it was never started."""
        return _read_status(self.folder(cell))

    def cells(self) -> list[StoredCell]:
        """Every cell in the folder, in an order that does not depend on when each was run."""
        found = [read_cell(path.parent) for kind in KINDS.values() for path in self.path.glob(f"{kind}/*/cell.json")]
        return in_order(found)

    def sessions(self) -> list[dict[str, Any]]:
        """What `environment.json` says of each command that ran cells here; empty before the first."""
        path = self.path / ENVIRONMENT
        return json.loads(path.read_text(encoding="utf-8"))["sessions"] if path.exists() else []

    def known_gaps(self) -> dict[str, dict[str, str]]:
        """Backend -> lines of the contract that it was known not to keep, with the reasons, in any session."""
        gaps: dict[str, dict[str, str]] = {}
        for session in self.sessions():
            for backend, reasons in session.get("known_gaps", {}).items():
                gaps.setdefault(backend, {}).update(reasons)
        return gaps


def read_cell(folder: Path) -> StoredCell:
    """The cell in `folder`. Raises `RunFolderError` when another version of causalbench wrote it."""
    content = json.loads((folder / "cell.json").read_text(encoding="utf-8"))
    if content.pop("schema", None) != SCHEMA:
        raise RunFolderError(
            f"{folder}: written by another version of causalbench; run the suite again with a new --out"
        )
    return StoredCell(content.pop("id"), content, _read_status(folder), folder)


def grid_text(identity: Mapping[str, Any]) -> str:
    """The settings of a grid in the identity of a cell, as one text."""
    return ", ".join(
        f"{key}={value if isinstance(value, str) else json.dumps(value)}"
        for key, value in identity.get("grid_point", {}).items()
    )


def in_order(cells: Iterable[StoredCell]) -> list[StoredCell]:
    """The cells by task, backend, method, grid_point and seed."""
    return sorted(cells, key=_order)


def _order(cell: StoredCell) -> tuple[str, str, str, str, int, str]:
    identity = cell.identity
    method = identity.get("method", {}).get("name", "")
    return identity["task"]["name"], identity["backend"]["name"], method, cell.grid_point, identity["seed"], cell.id


def _read_status(folder: Path) -> Status:
    try:
        content = json.loads((folder / "status.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return PENDING
    return Status(**{field.name: content[field.name] for field in dataclasses.fields(Status)})


def check_comparable(cells: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    """Raise `RunFolderError` unless the cells, (where it comes from, identity), may stand in one table.

    Task and code must be the same throughout, and backend, budget and settings for each backend, method and grid_point.
    """
    seen: dict[tuple[str, ...], tuple[str, Any]] = {}
    for where, identity in cells:
        for scope, value in _scopes(identity).items():
            other, expected = seen.setdefault(scope, (where, value))
            if value != expected:
                raise RunFolderError(
                    f"{where} and {other} cannot be compared: {' '.join(scope)} is {_differing(value, expected)}; "
                    f"use another --out, or run both with the same suite and versions"
                )


def _scopes(identity: Mapping[str, Any]) -> dict[tuple[str, ...], Any]:
    backend, kind = identity["backend"]["name"], identity["kind"]
    grid_point = tuple(filter(None, [grid_text(identity)]))
    scopes: dict[tuple[str, ...], Any] = {
        ("causalbench's version",): identity["code"],
        ("the task",): identity["task"],
        ("backend", backend): identity["backend"],
    }
    if kind == "discovery":
        return scopes | {("discovery on", backend, *grid_point): identity["settings"]}
    method = identity["method"]["name"]
    return scopes | {
        ("the budget",): {"env_steps": identity["env_steps"]},
        ("evaluation on", backend, *grid_point): identity["evaluation"],
        ("method", method): identity["method"],
        ("the learner of", method, "on", backend, *grid_point): identity["learner"],
    }


def _differing(value: Any, expected: Any) -> str:
    if not isinstance(value, Mapping):
        return f"{value!r} and {expected!r}"
    keys = [key for key in value if value[key] != expected.get(key)]
    return " and ".join(str({key: side.get(key) for key in keys}) for side in (value, expected))
