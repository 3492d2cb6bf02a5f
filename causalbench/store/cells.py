"""A cell as it lies on disk: `cell.json` says what it is, `status.json`, written last, how it stands.

A finished cell's `status.json` holds the SHA-256 of each of its files; what is read of a cell has been checked.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from annotated_types import Ge
from pydantic import StringConstraints

from causalbench import formats
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.records import Episode, Evaluation
from causalbench.errors import DamagedFileError
from causalbench.names import PATTERN
from causalbench.store.beside import BESIDE, read_beside
from causalbench.store.cell_progress import PROGRESS
from causalbench.store.episodes import read_episodes
from causalbench.store.files import check_digests, digests, is_file, is_folder, read_json, validated
from causalbench.store.records import Counts, read_counts, read_effects, read_progress
from causalbench.suite.cells import cell_id

State = Literal["done", "failed", "timeout", "diverged", "skipped", "running", "pending", "damaged"]
STATES: tuple[str, ...] = get_args(State)
CELL, STATUS = "cell.json", "status.json"
DATA = "data"
"""The samples of a discovery cell: an unfinished one continues from those that are there."""
CHECKPOINT = "checkpoint.safetensors"
"""What an unfinished learner cell continues from."""
LOG = "log.txt"
POLICY = "policy"
"""The folder of a finished learner's policy, which may be left out of what is published."""
KINDS = {"learner": "cells", "discovery": "discovery"}
"""Kind of a cell -> the folder that such cells lie in."""
NO_RESULTS = frozenset({CELL, STATUS, LOG, CHECKPOINT, PROGRESS, DATA, *BESIDE, "figures", "tensorboard"})
"""What may lie in a cell's folder without being a result; samples have digests of their own."""
PROGRESS_TABLE = "progress.csv"
"""The evaluations of a learner cell; there since the first of them."""
RESULTS = {
    "learner": frozenset({PROGRESS_TABLE, "episodes.csv", "counts.json"}),
    "discovery": frozenset({"graph.json", "manual.json", "evidence.csv"}),
}
"""Kind of a cell -> the files that every finished one has."""

Number = Annotated[int, Ge(0)]
Name = Annotated[str, StringConstraints(pattern=f"^{PATTERN}$")]


@dataclass(frozen=True)
class Status:
    """How a cell stands. `reason` is a sentence unless it is done; `seconds` and `env_steps` are what it took.

    `source` has a hash of the source code of causalbench and of each plugin that it used, `package=hash` with spaces.
    `files` has the SHA-256 of every result file of a cell that is done, by its path in the cell's folder. A cell is
    "damaged" if it says that it is done and its files are not the ones that were written then.
    """

    state: State
    reason: str = ""
    seconds: float = 0.0
    env_steps: Number = 0
    source: str = ""
    files: Mapping[str, str] = field(default_factory=dict)


PENDING = Status("pending")


@dataclass(frozen=True)
class _Named:
    name: Name


@dataclass(frozen=True)
class _Method(_Named):
    learner: Name


@dataclass(frozen=True)
class _Shared:
    """What every `cell.json` has."""

    kind: Literal["learner", "discovery"]
    code: str
    task: _Named
    backend: _Named
    seed: Number
    grid_point: Mapping[str, Any]


@dataclass(frozen=True)
class _Discovery(_Shared):
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class _Learner(_Shared):
    method: _Method
    env_steps: Number
    learner: Mapping[str, Any]
    evaluation: Mapping[str, Any]


@dataclass(frozen=True)
class StoredCell:
    """A cell as it lies on disk; `identity` is all that its id is a hash of, as JSON data."""

    id: str
    identity: Mapping[str, Any]
    status: Status
    folder: Path

    @property
    def kind(self) -> str:
        """What the cell is, "learner" or "discovery"."""
        return str(self.identity["kind"])

    @property
    def task(self) -> str:
        """The name of its task."""
        return str(self.identity["task"]["name"])

    @property
    def backend(self) -> str:
        """The name of its backend."""
        return str(self.identity["backend"]["name"])

    @property
    def method(self) -> str:
        """The name of its method; "" for a discovery."""
        return str(self.identity.get("method", {}).get("name", ""))

    @property
    def discoverer(self) -> str:
        """Who discovers; "" for a training run."""
        return str(self.identity.get("settings", {}).get("discoverer", ""))

    @property
    def seed(self) -> int:
        """Its seed."""
        return int(self.identity["seed"])

    @property
    def grid_point(self) -> str:
        """The settings of a suite's grid that made it, such as "learner.gamma=0.9"; "" without a grid."""
        return grid_text(self.identity)

    def is_done(self, kind: str) -> bool:
        """Whether it is a finished cell of this kind."""
        return self.kind == kind and self.status.state == "done"

    def file(self, name: str) -> Path:
        """The result file `name`. Raises `DamagedFileError` unless it was there when the cell finished."""
        if name not in self.status.files:
            raise DamagedFileError(f"{self.folder / name}: the cell, which is {self.status.state}, has no such result")
        return self.folder / name

    def evaluations(self) -> list[Evaluation]:
        """What a finished learner was examined for, in order of its training."""
        return read_progress(self.file("progress.csv"))

    def episodes(self) -> list[Episode]:
        """The episodes of a finished learner's last evaluation; empty where the learner keeps none."""
        return read_episodes(self.file("episodes.csv"))

    def beside(self, file: str) -> list[dict[str, Any]]:
        """The rows of a table that a later command made of a finished learner's policy; none where nobody asked."""
        return read_beside(self.folder, file)

    def counts(self) -> Counts:
        """What the training of a finished learner added up to."""
        return read_counts(self.file("counts.json"))

    def graph(self) -> CausalGraph:
        """The graph that a finished discovery found, or that a finished learner made for itself."""
        return CausalGraph.load(self.file("graph.json"))

    def human_graph(self) -> CausalGraph:
        """The declared graph of a finished discovery's task, beside which its own is shown."""
        return CausalGraph.load(self.file("manual.json"))

    def log_tail(self, lines: int) -> str:
        """The last `lines` of its log, whatever bytes are in it; "" without a log."""
        path = self.folder / LOG
        if not is_file(path):
            return ""
        return "\n".join(path.read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])

    def effects(self) -> dict[tuple[int, str, str], dict[str, str]]:
        """The oracle's words on each edge of a finished discovery, see `read_effects`; empty where none was asked."""
        return read_effects(self.file("oracle.csv")) if "oracle.csv" in self.status.files else {}

    def policy_folder(self) -> Path:
        """Where the policy of a finished learner lies. Raises `DamagedFileError` if it is not here."""
        if not any(name.startswith(f"{POLICY}/") for name in self.status.files):
            raise DamagedFileError(f"{self.folder}: the cell, which is {self.status.state}, has no policy")
        if not is_folder(self.folder / POLICY):
            raise DamagedFileError(
                f"{self.folder}: published without its policy; to have it, run the cell again elsewhere"
            )
        return self.folder / POLICY


def read_cell(folder: Path) -> StoredCell:
    """The cell in `folder`, whose name must be its id and the id that of its content.

    Raises `DamagedFileError` when it cannot be told what the cell is. Where that can be told and the rest is damaged,
    the cell's state says so.
    """
    if not is_folder(folder):
        raise DamagedFileError(f"{folder}: a link or a file, not a folder")
    identity = read_json(folder / CELL)
    schema, found = identity.pop("schema", None), identity.pop("id", None)
    if schema != formats.CELL:
        raise DamagedFileError(
            f"{folder / CELL}: schema {schema!r}, and this version of causalbench reads {formats.CELL}"
        )
    validated(folder / CELL, _Learner if identity.get("kind") == "learner" else _Discovery, identity)
    expected = cell_id(identity)
    if (found, folder.parent.name) != (expected, KINDS[identity["kind"]]):
        raise DamagedFileError(f"{folder / CELL}: says that it is {found!r}, but its content is that of {expected!r}")
    if folder.name != expected:
        raise DamagedFileError(f"{folder}: a copy of the cell {expected}, which is not counted a second time")
    return StoredCell(expected, identity, _read_status(folder, identity["kind"]), folder)


def _read_status(folder: Path, kind: str) -> Status:
    path = folder / STATUS
    if not path.exists() and not path.is_symlink():
        return PENDING
    try:
        content = read_json(path)
        if content.get("schema") != formats.CELL:
            raise DamagedFileError(f"{path}: schema {content.get('schema')!r}, expected {formats.CELL}")
        status = validated(path, Status, content)
        if status.state == "done":
            _check_results(folder, kind, status)
    except DamagedFileError as error:
        return Status("damaged", str(error))
    return status


def _check_results(folder: Path, kind: str, status: Status) -> None:
    if missing := sorted(RESULTS[kind] - status.files.keys()):
        raise DamagedFileError(f"{folder / STATUS}: no SHA-256 of {', '.join(missing)}")
    left_out = not os.path.lexists(folder / POLICY)
    here = {name: found for name, found in status.files.items() if not (left_out and name.startswith(f"{POLICY}/"))}
    check_digests(folder, here)


def result_digests(folder: Path) -> dict[str, str]:
    """Path in a cell's `folder` -> SHA-256 of each file that is a result."""
    return digests(folder, NO_RESULTS)


def grid_text(identity: Mapping[str, Any]) -> str:
    """The settings of a grid in the identity of a cell, as one text."""
    return ", ".join(
        f"{key}={value if isinstance(value, str) else json.dumps(value)}"
        for key, value in identity.get("grid_point", {}).items()
    )


def in_order(cells: Iterable[StoredCell]) -> list[StoredCell]:
    """The cells by task, backend, method, grid_point and seed."""
    return sorted(cells, key=lambda cell: (cell.task, cell.backend, cell.method, cell.grid_point, cell.seed, cell.id))
