"""Finds plugins and looks up what they registered. Nothing is loaded when this module is imported.

Each plugin is loaded on its own: one that cannot be imported, misspells a hook or registers a taken name becomes a
`PluginRow` with its error and never stops another.
"""

from __future__ import annotations

import functools
import importlib.metadata
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any, Protocol, TypeVar, cast

import pluggy

from causalbench._version import __version__
from causalbench.core.discovery.registry import Discoverer
from causalbench.core.learners.methods import Method
from causalbench.core.learners.registry import Learner
from causalbench.core.tasks.stage_task import StageTask, base_name
from causalbench.errors import BackendLoadError, UnknownNameError, UserError
from causalbench.names import check_name
from causalbench.plugins import hookspecs
from causalbench.plugins.backends import Backend, missing_modules

GROUP = "causalbench"
KINDS = ("backends", "tasks", "methods", "learners", "discoverers")
"""What plugins register: `causalbench_KIND` is the hook, and `Plugins.KIND` has the rows by name."""
OWN_DISTRIBUTION = "causalbench-robotics"
LIST_COMMAND = "`causalbench backends` lists what is installed."


class _Named(Protocol):
    @property
    def name(self) -> str: ...


NamedT = TypeVar("NamedT", bound=_Named)
OptionalT = TypeVar("OptionalT", Discoverer, Learner)


@dataclass(frozen=True)
class PluginRow:
    """One installed plugin: its distribution, that one's version, and why it could not be loaded ("" if it was).

    `entry_point` is its name in the group "causalbench".
    """

    distribution: str
    version: str
    entry_point: str = ""
    error: str = ""

    def may_register(self, backend: str) -> bool:
        """Whether the plugin is called after `backend`, as its entry point or as its distribution."""
        called = {_spelt(backend), _spelt(f"causalbench-{backend}")}
        return backend == self.entry_point or _spelt(self.distribution) in called


@dataclass
class Plugins:
    """What is installed, by name.

    `owners` says which plugin registered a backend, `packages` from which top-level package a thing was registered:
    (kind, name) -> package.
    """

    backends: dict[str, Backend] = field(default_factory=dict)
    tasks: dict[str, StageTask] = field(default_factory=dict)
    methods: dict[str, Method] = field(default_factory=dict)
    learners: dict[str, Learner] = field(default_factory=dict)
    discoverers: dict[str, Discoverer] = field(default_factory=dict)
    owners: dict[str, PluginRow] = field(default_factory=dict)
    packages: dict[tuple[str, str], str] = field(default_factory=dict)
    rows: list[PluginRow] = field(default_factory=list)

    def backend(self, name: str) -> Backend:
        """The backend `name`, its simulator installed.

        Raises `UnknownNameError`, or `BackendLoadError` with the command that installs what is missing.
        """
        if name not in self.backends:
            raise self._no_backend(name)
        problem = self.problem(name)
        if problem:
            raise BackendLoadError(f"backend {name!r} {problem}")
        return self.backends[name]

    def problem(self, name: str) -> str:
        """What the registered backend `name` lacks and how to install it; "" if it lacks nothing."""
        missing = missing_modules(self.backends[name].modules)
        if not missing:
            return ""
        return f"needs {', '.join(missing)}, not installed here; run: pip install {self.owners[name].distribution}"

    def task(self, name: str) -> StageTask:
        """The task `name`, which may say a change of a registered one, or an `UnknownNameError`.

        See `causalbench.core.tasks.changes.named`. Raises `UserError` for a change that does not fit the task.
        """
        task = _look_up("task", base_name(name) if isinstance(name, str) else name, self.tasks)
        if task.name == name:
            return task
        from causalbench.core.tasks.changes.named import changed

        return changed(task, name)

    def method(self, name: str) -> Method:
        """The method `name`, or an `UnknownNameError`."""
        return _look_up("method", name, self.methods)

    def discoverer(self, name: str) -> Discoverer:
        """The discoverer `name`; an `UnknownNameError`, or a `UserError` that says how to install what it lacks."""
        return _usable("discoverer", name, self.discoverers)

    def learner(self, name: str) -> Learner:
        """The learner `name`; an `UnknownNameError`, or a `UserError` that says how to install what it lacks."""
        return _usable("learner", name, self.learners)

    def _no_backend(self, name: str) -> UserError:
        for row in self.rows:
            if row.error and row.may_register(name):
                return BackendLoadError(
                    f"backend {name!r}: its plugin {row.distribution} {row.version} could not be loaded: {row.error}. "
                    f"Try: pip install --upgrade {row.distribution}"
                )
        broken = [row.distribution for row in self.rows if row.error]
        hint = f"A backend comes with its plugin (pip install causalbench-{name}); {LIST_COMMAND}"
        if broken:
            hint += f" Could not be loaded: {', '.join(broken)}."
        return UnknownNameError("backend", name, self.backends, hint)


def _spelt(distribution: str) -> str:
    """A distribution's name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", distribution).lower()


def _look_up(kind: str, name: str, known: Mapping[str, NamedT]) -> NamedT:
    if name not in known:
        raise UnknownNameError(kind, name, known)
    return known[name]


def _usable(kind: str, name: str, known: Mapping[str, OptionalT]) -> OptionalT:
    """The row `name`, whose optional imports are there."""
    found = _look_up(kind, name, known)
    if missing := missing_modules(found.modules):
        raise UserError(
            f"{kind} {name!r} needs {', '.join(missing)}, not installed here; run: pip install {found.extra!r}"
        )
    return found


@functools.cache
def installed() -> Plugins:
    """`load_plugins()`, once a process."""
    return load_plugins()


def load_plugins() -> Plugins:
    """The built-ins and every entry point of the group "causalbench"; see the module for what a failure does."""
    from causalbench.plugins import builtins

    plugins = Plugins()
    manager = pluggy.PluginManager("causalbench")
    manager.add_hookspecs(hookspecs)
    own = PluginRow(OWN_DISTRIBUTION, __version__)
    sources: list[tuple[PluginRow, Callable[[], ModuleType]]] = [(own, lambda: builtins), *_entry_points()]
    for row, load in sources:
        try:
            _register(manager, load(), row, plugins)
        except (Exception, SystemExit) as error:  # a stranger's code may raise anything
            row = replace(row, error=f"{type(error).__name__}: {error}")
        plugins.rows.append(row)
    return plugins


def _entry_points() -> Iterator[tuple[PluginRow, Callable[[], ModuleType]]]:
    """(plugin, function that imports it), in an order that does not depend on the search path."""
    found = importlib.metadata.entry_points(group=GROUP)
    for point in sorted(found, key=lambda p: (p.dist.name if p.dist else "", p.name)):
        distribution, version = (point.dist.name, point.dist.version) if point.dist else (point.value, "")
        yield PluginRow(distribution, version, point.name), point.load


def _register(manager: pluggy.PluginManager, plugin: ModuleType, row: PluginRow, plugins: Plugins) -> None:
    """Add all that `plugin` registers, or nothing if any part of it is wrong."""
    manager.register(plugin)
    try:
        manager.check_pending()
        found: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}
        for caller in manager.get_hookcallers(plugin) or ():
            kind = caller.name.removeprefix("causalbench_")
            register = functools.partial(_add, kind.removesuffix("s"), found[kind], getattr(plugins, kind))
            for implementation in caller.get_hookimpls():
                if implementation.plugin is plugin:
                    cast(Callable[..., None], implementation.function)(register)
    except (Exception, SystemExit):
        # A misspelt hook left behind would make check_pending fail for every later plugin.
        manager.unregister(plugin)
        raise
    for kind, rows in found.items():
        getattr(plugins, kind).update(rows)
        plugins.packages |= {(kind, name): plugin.__name__.partition(".")[0] for name in rows}
    plugins.owners |= dict.fromkeys(found["backends"], row)


def _add(kind: str, found: dict[str, NamedT], known: Mapping[str, NamedT], item: NamedT) -> None:
    check_name(kind, item.name)
    if item.name in found or item.name in known:
        raise UserError(f"{kind} {item.name!r} is already registered; choose another name")
    found[item.name] = item
