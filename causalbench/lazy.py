"""Names of a module that are imported when they are first asked for (PEP 562)."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazy(module: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """A `__getattr__` for `module`: name -> the module that has it, or that it is the last part of.

    It raises `AttributeError` for any other name.
    """

    def attribute(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        found = importlib.import_module(homes[name])
        return found if homes[name].endswith(f".{name}") else getattr(found, name)

    return attribute
