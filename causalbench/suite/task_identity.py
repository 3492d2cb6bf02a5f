"""A task as it enters a cell: everything in it that can change a number."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from causalbench.core.kinematic.task_trace import trace_hash
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.tasks.task import Task
from causalbench.errors import CausalbenchError
from causalbench.suite.cells import TaskIdentity

IDENTIFIERS = ("name", "version")


def task_identity(task: StageTask) -> TaskIdentity:
    """The identity of `task`."""
    return TaskIdentity(task.name, task.version, task_data(task), _behaviour(task))


def task_data(task: StageTask) -> dict[str, Any]:
    """The fields of `task` that hold no function, beside its name and version, as JSON data."""
    fields = {field.name: getattr(task, field.name) for field in dataclasses.fields(task)}
    return {name: _data(value) for name, value in fields.items() if name not in IDENTIFIERS and not callable(value)}


def _behaviour(task: StageTask) -> str:
    if isinstance(task, Task):
        try:
            return f"trace {trace_hash(task)}"
        except CausalbenchError:  # other actions or capabilities than the kinematic backend's
            pass
    return f"source {_source_hash(task)}"


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
    return value.tolist() if hasattr(value, "tolist") else value


def _source_hash(task: StageTask) -> str:
    """Of the sources of every module that a function of the task comes from."""
    functions = [getattr(task, field.name) for field in dataclasses.fields(task)]
    modules = {inspect.getmodule(function) for function in functions if callable(function)}
    texts = sorted(inspect.getsource(module) for module in modules if isinstance(module, ModuleType))
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]
