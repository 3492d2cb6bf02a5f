"""Cells: what determines a result, and the id that is a hash of just that."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners.methods import Method
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.digests import content_hash

GridPoint = Mapping[str, Any]
"""The settings of a suite's grid that reached a cell: dotted key -> value. Empty without a grid."""


@dataclass(frozen=True)
class TaskIdentity:
    """A task's name and version, its data, and what its functions do.

    `data` are the fields of the task that hold no function: constants, terms, actions, the human's graph and so on.
    `behaviour` is the hash of its trace on the kinematic backend, or of the source of its functions' modules where that
    backend cannot run it.
    """

    name: str
    version: int
    data: Mapping[str, Any]
    behaviour: str

    @cached_property
    def plain(self) -> dict[str, Any]:
        """It as JSON data, made once: all cells of a plan share it, and a task is most of what a cell's id covers."""
        return _plain(dataclasses.asdict(self))


@dataclass(frozen=True)
class BackendIdentity:
    """A backend as it enters a cell: its plugin's version and those of the modules it imports."""

    name: str
    version: str
    modules: Mapping[str, str]
    options: Mapping[str, str | int | float | bool]


@dataclass(frozen=True)
class DiscoveryCell:
    """One causal discovery."""

    code: str  # causalbench's version
    task: TaskIdentity
    backend: BackendIdentity
    seed: int
    settings: DiscoverySettings
    grid_point: GridPoint = field(default_factory=dict)

    cores: ClassVar[int] = 2  # processes that collect samples; no part of the result, nor of the id

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All that the id is made of, as JSON data."""
        return _identity("discovery", self)

    @cached_property
    def id(self) -> str:
        """See `cell_id`."""
        return cell_id(self.identity)


@dataclass(frozen=True)
class LearnerCell:
    """One training run. `discovery` is the cell whose graph it learns with, None if its method needs none.

    A method on an oracle's graph asks about actions held for `action_repeat` control steps, as those of a discovery by
    the suite's settings are; 1 for any other method.
    """

    code: str
    task: TaskIdentity
    backend: BackendIdentity
    method: Method
    seed: int
    env_steps: int
    learner: Any  # the record of the method's learner
    evaluation: EvaluationSettings
    discovery: DiscoveryCell | None
    action_repeat: int = 1
    grid_point: GridPoint = field(default_factory=dict)

    cores: ClassVar[int] = 1

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All that the id is made of, as JSON data; a discovery cell enters as its id."""
        own = {"method": self.method.identity, "discovery": self.discovery.id if self.discovery else None}
        return _identity("learner", self, **own)

    @cached_property
    def id(self) -> str:
        """See `cell_id`."""
        return cell_id(self.identity)


Cell = DiscoveryCell | LearnerCell


def _identity(kind: str, cell: DiscoveryCell | LearnerCell, **instead: Any) -> dict[str, Any]:
    """The fields of a cell as JSON data, those of records by name; `instead` replaces some of them."""
    values = {field.name: getattr(cell, field.name) for field in dataclasses.fields(cell)} | instead
    own = {k: dataclasses.asdict(v) if dataclasses.is_dataclass(v) else v for k, v in values.items() if k != "task"}  # type: ignore[arg-type]
    plain = _plain({"kind": kind} | own)
    return {"kind": kind} | {name: cell.task.plain if name == "task" else plain[name] for name in values}


def _plain(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a reader of the content's JSON gets, so that it equals an identity from disk (a tuple is a list)."""
    data: dict[str, Any] = json.loads(json.dumps(content))
    return data


def cell_id(identity: Mapping[str, Any]) -> str:
    """The id of a cell with this identity: a slug to read and the start of a SHA-256."""
    method = [identity["method"]["name"]] if "method" in identity else []
    slug = [identity["task"]["name"], identity["backend"]["name"], *method, f"s{identity['seed']}"]
    return "-".join([*slug, content_hash(identity)])
