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
from causalbench.core.tasks.task_data import task_data
from causalbench.plugins.venues import venue_of
from causalbench.suite.cells import TaskIdentity


def task_identity(task: StageTask) -> TaskIdentity:
    """The identity of `task`."""
    return TaskIdentity(task.name, task.version, task_data(task), _behaviour(task))


def _behaviour(task: StageTask) -> str:
    trace = venue_of(task).trace_hash()
    return f"trace {trace}" if trace else f"source {_source_hash(task)}"


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
