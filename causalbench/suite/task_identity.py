"""A task as it enters a cell: everything in it that can change a number."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import ModuleType
from typing import Any

from causalbench.core.tasks.stage_task import StageTask
from causalbench.plugins.venues import venue_of
from causalbench.suite.cells import TaskIdentity

IDENTIFIERS = ("name", "version")


def task_identity(task: StageTask) -> TaskIdentity:
    """The identity of `task`."""
    return TaskIdentity(task.name, task.version, task_data(task), _behaviour(task))


def task_data(task: StageTask) -> dict[str, Any]:
    """The fields of `task` that are no function, beside its name and version, as JSON data.

    A `functools.partial` is data, too: the function's name and the arguments.
    """
    fields = {field.name: getattr(task, field.name) for field in dataclasses.fields(task)}
    return {name: _data(value) for name, value in fields.items() if name not in IDENTIFIERS and not _is_plain(value)}


def _is_plain(value: Any) -> bool:
    """Whether `value` is a function that its source says all of."""
    return callable(value) and not isinstance(value, functools.partial)


def _behaviour(task: StageTask) -> str:
    trace = venue_of(task).trace_hash()
    return f"trace {trace}" if trace else f"source {_source_hash(task)}"


def _data(value: Any) -> Any:
    """Plain data of records, sets, mappings, tuples and arrays."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _data(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _data(item) for key, item in value.items()}
    if isinstance(value, frozenset | set):
        return sorted(map(str, value))
    if isinstance(value, tuple | list):
        return [_data(item) for item in value]
    if isinstance(value, functools.partial):
        return {"function": _data(value.func), "arguments": _data([value.args, value.keywords])}
    if callable(value):
        return f"{value.__module__}.{value.__qualname__}"
    return value.tolist() if hasattr(value, "tolist") else value


def _source_hash(task: StageTask) -> str:
    """Of the sources of every module that a function of the task comes from."""
    values = [getattr(task, field.name) for field in dataclasses.fields(task)]
    modules = {inspect.getmodule(function) for function in _functions(values)}
    texts = sorted(inspect.getsource(module) for module in modules if isinstance(module, ModuleType))
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]


def _functions(values: Iterable[Any]) -> Iterator[Callable[..., Any]]:
    """Every function among `values` and in their mappings."""
    for value in values:
        if isinstance(value, Mapping):
            yield from _functions(value.values())
        elif isinstance(value, functools.partial):
            yield value.func
        elif callable(value):
            yield value
