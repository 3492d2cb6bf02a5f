"""Pytest plugin: `pytest --backend NAME` (repeatable) leaves out the tests of all other backends.

A test is of a backend by a parameter of `PARAMETERS`, by its class's attribute `backend`, as in `SceneConformance`, or
by its place in that backend's folder below plugins/. All other tests run as ever.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import pytest

from causalbench.core.world.capabilities import Capability
from causalbench.plugins.manager import installed

PARAMETERS = ("backend", "mobile_env", "mobile_bench")


def names() -> tuple[str, ...]:
    """Names of all installed backends with scenes, the reference backend first."""
    scenes = [name for name, backend in installed().backends.items() if backend.make is not None]
    return tuple(sorted(scenes, key=lambda name: (name != "kinematic", name)))


def driving() -> tuple[str, ...]:
    """Those of them whose robot can drive."""
    return tuple(
        name
        for name in names()
        if any(Capability.MOBILE_BASE in variant.capabilities for variant in installed().backends[name].variants)
    )


QUICK = ("kinematic", "pybullet")
"""The reference and one simulator. What is not about simulators is tested on the others by the long tests."""


def quick(backends: Iterable[str]) -> list[Any]:
    """Parameters for `backends`, those that are not `QUICK` marked `long`."""
    return [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in backends]


def chosen(config: pytest.Config) -> tuple[str, ...]:
    """Names of the backends under test."""
    wanted = config.getoption("--backend")
    return tuple(name for name in names() if name in wanted or not wanted)


def pytest_addoption(parser: pytest.Parser) -> None:
    text = "test only this backend (repeatable; default: every installed one)"
    parser.addoption("--backend", action="append", default=[], metavar="NAME", help=text)


def pytest_configure(config: pytest.Config) -> None:
    for name in config.getoption("--backend"):
        if name not in names():
            raise pytest.UsageError(f"--backend {name}: not installed; installed are {', '.join(names())}")


def _backend_of(item: pytest.Item) -> str | None:
    parameters = item.callspec.params if hasattr(item, "callspec") else {}
    folder = re.match(r"plugins/(\w+)_backend/", item.nodeid)
    named = next((parameters[name] for name in PARAMETERS if name in parameters), None)
    return named or getattr(item.cls, "backend", None) or (folder and folder[1])


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    others = [item for item in items if _backend_of(item) not in {None, *chosen(config)}]
    if config.getoption("--backend") and others:
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in others]
