"""The hooks a plugin may implement. Nothing here does anything; see docs/plugins.md for a worked example.

A plugin is a distribution with an entry point in the group "causalbench" that names a module with
functions decorated by `hookimpl`. Importing that module must not import a simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from causalbench.core.discovery.registry import Discoverer
    from causalbench.core.learners.methods import Method
    from causalbench.core.learners.registry import Learner
    from causalbench.core.tasks.task import Task
    from causalbench.core.world.capabilities import Capability
    from causalbench.core.world.scene import Scene

hookspec = pluggy.HookspecMarker("causalbench")
hookimpl = pluggy.HookimplMarker("causalbench")


@dataclass(frozen=True)
class Backend:
    """What `causalbench_backends` registers.

    `make(**options)` imports the simulator and returns a new scene; `engine` and `robot` are for people;
    `modules` are the imports that the simulator needs, so that a missing one is named without importing it;
    `capabilities` are those of its scenes' specs, so that they can be listed without making one;
    `mobile_capabilities` are those that `make(mobile=True)` adds: `MOBILE_BASE` and what comes with it. A backend whose
    robot does not drive has none, and its `make` no such option;
    `known_gaps` are lines of the contract (docs/conformance.md) that do not hold, with the reason: `{"S21": "..."}`.
    """

    name: str
    make: Callable[..., Scene]
    engine: str
    robot: str
    modules: tuple[str, ...] = ()
    capabilities: frozenset[Capability] = frozenset()
    known_gaps: Mapping[str, str] = field(default_factory=dict)
    mobile_capabilities: frozenset[Capability] = frozenset()


@hookspec
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Call `register(Backend(...))` once per simulator."""


@hookspec
def causalbench_tasks(register: Callable[[Task], None]) -> None:
    """Call `register(task)` once per task."""


@hookspec
def causalbench_methods(register: Callable[[Method], None]) -> None:
    """Call `register(Method(...))` once per row of the method table."""


@hookspec
def causalbench_learners(register: Callable[[Learner], None]) -> None:
    """Call `register(Learner(...))` once per learning algorithm."""


@hookspec
def causalbench_discoverers(register: Callable[[Discoverer], None]) -> None:
    """Call `register(Discoverer(...))` once per method of causal discovery; see docs/how-to/discoverer.md."""
