"""Which cells may stand in one table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from causalbench.errors import RunFolderError
from causalbench.store.cells import StoredCell, grid_text, in_order


def merged(cells: Iterable[StoredCell]) -> list[StoredCell]:
    """The cells of several run folders, one that stands in several once, the finished one if any is.

    Raises `RunFolderError` for a cell that has different results in two folders and for cells that cannot be compared.
    """
    found: dict[str, StoredCell] = {}
    for cell in cells:
        known = found.get(cell.id)
        if known and known.status.state == cell.status.state == "done":
            _check_same(known, cell)
        if known is None or cell.status.state == "done":
            found[cell.id] = cell
    check_comparable((str(cell.folder), cell.identity) for cell in found.values())
    return in_order(found.values())


def _check_same(one: StoredCell, other: StoredCell) -> None:
    mine, theirs = one.status.files, other.status.files
    if different := sorted(name for name in mine.keys() | theirs.keys() if mine.get(name) != theirs.get(name)):
        raise RunFolderError(
            f"{one.folder} and {other.folder} are the same cell with different results "
            f"({', '.join(different)}); find out which is right, and leave the other folder out"
        )


def check_comparable(cells: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    """Raise `RunFolderError` unless the cells, (where it comes from, identity), may stand in one table.

    Task and version must be the same throughout, but for tasks that a grid names, and backend, budget and settings for
    each backend, method, discoverer and point of a grid.
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
        ("the task", *filter(None, [identity["grid_point"].get("task")])): identity["task"],
        ("backend", backend): identity["backend"],
    }
    if kind == "discovery":
        by = ("discovery on", backend, "by", identity["settings"]["discoverer"])
        return scopes | {(*by, *grid_point): identity["settings"]}
    method = identity["method"]["name"]
    return scopes | {
        ("the budget on", backend): {"env_steps": identity["env_steps"]},
        ("evaluation on", backend, *grid_point): identity["evaluation"],
        ("method", method): identity["method"],
        ("the learner of", method, "on", backend, *grid_point): identity["learner"],
    }


def _differing(value: Any, expected: Any) -> str:
    if not isinstance(value, Mapping) or not isinstance(expected, Mapping):
        return f"{value!r} and {expected!r}"
    keys = [key for key in {**value, **expected} if value.get(key) != expected.get(key)]
    return " and ".join(str({key: side.get(key) for key in keys}) for side in (value, expected))
