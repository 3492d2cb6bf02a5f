"""The hooks a plugin may implement. Nothing here does anything; docs/how-to says how, examples/ has one of each.

A plugin is a distribution with an entry point in the group "causalbench" that names a module with
functions decorated by `hookimpl`. Importing that module must not import a simulator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from causalbench.core.discovery.registry import Discoverer
    from causalbench.core.learners.methods import Method
    from causalbench.core.learners.registry import Learner
    from causalbench.core.tasks.stage_task import StageTask
    from causalbench.plugins.backends import Backend

hookspec = pluggy.HookspecMarker("causalbench")
hookimpl = pluggy.HookimplMarker("causalbench")


@hookspec
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Call `register(Backend(...))` once per simulator."""


@hookspec
def causalbench_tasks(register: Callable[[StageTask], None]) -> None:
    """Call `register(task)` once per task: a `Task` over scenes or a `GymTask` over Gymnasium environments."""


@hookspec
def causalbench_methods(register: Callable[[Method], None]) -> None:
    """Call `register(Method(...))` once per row of the method table."""


@hookspec
def causalbench_learners(register: Callable[[Learner], None]) -> None:
    """Call `register(Learner(...))` once per learning algorithm."""


@hookspec
def causalbench_discoverers(register: Callable[[Discoverer], None]) -> None:
    """Call `register(Discoverer(...))` once per method of causal discovery; see docs/how-to/discoverer.md."""
