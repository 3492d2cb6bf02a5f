"""What of a task is data: everything in it that can change a number and is no function, as JSON data."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

from causalbench.core.tasks.stage_task import StageTask

IDENTIFIERS = ("name", "version")


def task_data(task: StageTask) -> dict[str, Any]:
    """The fields of `task` that are no function, beside its name and version, as JSON data.

    A `functools.partial` is data, too: the function's name and the arguments.
    """
    fields = {field.name: getattr(task, field.name) for field in dataclasses.fields(task)}
    return {name: _data(value) for name, value in fields.items() if name not in IDENTIFIERS and not _is_plain(value)}


def _is_plain(value: Any) -> bool:
    """Whether `value` is a function that its source says all of."""
    return callable(value) and not isinstance(value, functools.partial)


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
