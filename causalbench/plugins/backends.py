"""What a plugin registers of a simulator. It tells without making a scene which tasks the simulator can run."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.tasks.task import Task
from causalbench.errors import UserError

if TYPE_CHECKING:
    from causalbench.core.world.capabilities import Capability
    from causalbench.core.world.scene import Scene

NO_OPTIONS: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Variant:
    """One robot of a backend: the scenes that `make(**options)` returns have `robot` and `capabilities` in their spec.

    The backend's first variant has no options: it is what `make()` returns.
    """

    robot: str
    capabilities: frozenset[Capability] = frozenset()
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Backend:
    """What `causalbench_backends` registers. Raises `UserError` for variants that `make` cannot make.

    - `make(**options)` imports the simulator and returns a new scene; None where there are no scenes, since the tasks
      of this backend bring their environments along;
    - `engine` is for people;
    - `variants` say what scenes there are, the one without options first;
    - `modules` are the imports that the simulator needs, so that a missing one is named without importing it;
    - `known_gaps` are lines of the contract (docs/conformance.md) that do not hold, with the reason: `{"S21": "..."}`.
    """

    name: str
    make: Callable[..., Scene] | None
    engine: str
    variants: tuple[Variant, ...] = ()
    modules: tuple[str, ...] = ()
    known_gaps: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.make is not None and (not self.variants or self.variants[0].options):
            raise UserError(f"backend {self.name!r}: the first of its variants must be the one without options")
        for variant in self.variants:
            self.maker(variant.options)

    def maker(self, options: Mapping[str, Any] = NO_OPTIONS) -> Callable[[], Scene]:
        """A function that makes new scenes with `options`.

        Raises `UserError`, which says what exists, when `make` takes no such options or there are no scenes.
        """
        if self.make is None:
            raise UserError(f"backend {self.name!r} makes no scenes: its tasks bring their environments along")
        signature = inspect.signature(self.make)
        try:
            signature.bind(**options)
        except TypeError as error:
            known = ", ".join(str(p.replace(annotation=p.empty)) for p in signature.parameters.values()) or "none"
            raise UserError(f"options of backend {self.name!r}: {error}; it takes {known}") from error
        return functools.partial(self.make, **options)

    def variant(self, options: Mapping[str, Any] = NO_OPTIONS) -> Variant:
        """What `make(**options)` returns: of the variants whose options are among these, the one with the most."""
        self.maker(options)
        fitting = (v for v in self.variants if all(options.get(key) == value for key, value in v.options.items()))
        return max(fitting, key=lambda variant: len(variant.options))

    def refusal(self, task: StageTask, options: Mapping[str, Any] = NO_OPTIONS) -> str:
        """Why scenes made for `task` with further `options` cannot run it, in a sentence; "" if they can."""
        if not isinstance(task, Task):
            return f"backend {self.name!r} cannot run task {task.name!r}, which is not played in scenes"
        try:
            variant = self.variant({**task.scene_options, **options})
        except UserError as error:
            return f"backend {self.name!r} cannot run task {task.name!r}: {error}"
        lacking = sorted(task.requires - variant.capabilities)
        if not lacking:
            return ""
        return (
            f"backend {self.name!r} cannot run task {task.name!r}: its robot ({variant.robot}) lacks "
            f"{', '.join(lacking)}; `causalbench backends` lists what each can do"
        )
