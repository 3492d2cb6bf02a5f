"""What a plugin registers of a simulator, so that its robots and what they can do are known without making a scene."""

from __future__ import annotations

import functools
import importlib.util
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from causalbench.errors import UserError

if TYPE_CHECKING:
    from causalbench.core.world.capabilities import Capability
    from causalbench.core.world.scene import Scene

NO_OPTIONS: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Variant:
    """One robot of a backend. The scenes that `make(**options)` returns have `robot` and `capabilities` in their spec.

    The backend's first variant has no options: it is what `make()` returns.
    """

    robot: str
    capabilities: frozenset[Capability] = frozenset()
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Backend:
    """A backend, as a plugin registers it. Raises `UserError` for variants that `make` cannot make.

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
        return bound(self.make, options, f"options of backend {self.name!r}")

    def variant(self, options: Mapping[str, Any] = NO_OPTIONS) -> Variant:
        """What `make(**options)` returns: of the variants whose options are among these, the one with the most."""
        self.maker(options)
        fitting = (v for v in self.variants if all(options.get(key) == value for key, value in v.options.items()))
        return max(fitting, key=lambda variant: len(variant.options))


def bound(make: Callable[..., Any], options: Mapping[str, Any], what: str) -> Callable[[], Any]:
    """`make` with `options`. Raises a `UserError`, which begins with `what` and says what exists, for others.

    An option whose default is a boolean, a number or a text takes another of that kind.
    """
    parameters = inspect.signature(make).parameters
    known = ", ".join(str(p.replace(annotation=p.empty)) for p in parameters.values()) or "none"
    try:
        inspect.signature(make).bind(**options)
    except TypeError as error:
        raise UserError(f"{what}: {error}; it takes {known}") from error
    for name, value in options.items():
        if name in parameters and not _is_like(value, parameters[name].default):
            kind = _KINDS[type(parameters[name].default)]
            raise UserError(f"{what}: {name}={value!r} is no {kind}; it takes {known}")
    return functools.partial(make, **options)


def _is_like(value: Any, default: Any) -> bool:
    """Whether `value` is of the kind of `default`; anything is where that is of no plain kind."""
    if type(default) not in _KINDS:
        return True
    return type(value) is type(default) or (type(default) is float and type(value) is int)


_KINDS = {bool: "boolean", int: "whole number", float: "number", str: "text"}


def missing_modules(modules: Iterable[str]) -> list[str]:
    """Those of `modules` that cannot be imported, found without importing them."""
    return [m for m in modules if importlib.util.find_spec(m.partition(".")[0]) is None]
