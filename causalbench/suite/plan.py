"""The cells that a suite asks for. A cell is what determines a result, and its id is a hash of just that."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from causalbench._version import __version__
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners.methods import Method
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.tasks.task import Task
from causalbench.errors import SuiteError, UnknownNameError, UserError
from causalbench.plugins.hookspecs import Backend
from causalbench.plugins.manager import Plugins, scene_maker
from causalbench.suite.positions import Location
from causalbench.suite.schema import EVALUATION, LEARNER, DiscoveryPatch, PerBackend, PerMethod, Suite, SuiteFile, Tier

OWN_GRAPH_TIER = "full"
"""In this tier each seed discovers its own graph, since a shared one makes seeds dependent; else seed 0's is shared."""


@dataclass(frozen=True)
class TaskIdentity:
    """A task as it enters a cell."""

    name: str
    version: int
    constants: Mapping[str, float]


@dataclass(frozen=True)
class BackendIdentity:
    """A backend as it enters a cell: its plugin's version and those of the modules it imports."""

    name: str
    version: str
    modules: Mapping[str, str]
    options: Mapping[str, str | int | float | bool]


@dataclass(frozen=True)
class DiscoveryCell:
    """One causal discovery."""

    code: str  # causalbench's version
    task: TaskIdentity
    backend: BackendIdentity
    seed: int
    settings: DiscoverySettings

    cores: ClassVar[int] = 2  # processes that collect samples; no part of the result, nor of the id

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All that the id is made of, as JSON data."""
        return _plain({"kind": "discovery"} | dataclasses.asdict(self))

    @cached_property
    def id(self) -> str:
        """A slug to read and the start of a SHA-256."""
        return f"{self.task.name}-{self.backend.name}-s{self.seed}-{content_hash(self.identity)}"


@dataclass(frozen=True)
class LearnerCell:
    """One training run. `discovery` is the cell whose graph it learns with, None if its method needs none."""

    code: str
    task: TaskIdentity
    backend: BackendIdentity
    method: Method
    seed: int
    env_steps: int
    learner: Any  # the record of the method's learner
    evaluation: EvaluationSettings
    discovery: DiscoveryCell | None

    cores: ClassVar[int] = 1

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All that the id is made of, as JSON data; a discovery cell enters as its id."""
        own = dataclasses.asdict(dataclasses.replace(self, discovery=None))
        return _plain({"kind": "learner"} | own | {"discovery": self.discovery.id if self.discovery else None})

    @cached_property
    def id(self) -> str:
        """A slug to read and the start of a SHA-256."""
        slug = f"{self.task.name}-{self.backend.name}-{self.method.name}-s{self.seed}"
        return f"{slug}-{content_hash(self.identity)}"


Cell = DiscoveryCell | LearnerCell


def _plain(content: Mapping[str, Any]) -> dict[str, Any]:
    """What a reader of the content's JSON gets, so that it equals an identity from disk (a tuple is a list)."""
    data: dict[str, Any] = json.loads(json.dumps(content))
    return data


def content_hash(content: Mapping[str, Any]) -> str:
    """First 10 hex digits of the SHA-256 of canonical JSON; the order of keys does not matter."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:10]


@dataclass(frozen=True)
class Selection:
    """What `--only` keeps; an empty set keeps everything."""

    backend: frozenset[str] = frozenset()
    method: frozenset[str] = frozenset()
    seed: frozenset[int] = frozenset()

    @classmethod
    def parse(cls, options: Iterable[str]) -> Selection:
        """From texts such as "backend=A,method=B,seed=0". Raises `UserError`."""
        found: dict[str, set[Any]] = {field.name: set() for field in dataclasses.fields(cls)}
        for part in (part.strip() for option in options for part in option.split(",")):
            key, equals, value = part.partition("=")
            if not equals or key not in found:
                raise UserError(f"--only {part!r}: expected backend=NAME, method=NAME or seed=NUMBER")
            if key == "seed" and not value.isdecimal():
                raise UserError(f"--only {part!r}: a seed is a number from 0")
            found[key].add(int(value) if key == "seed" else value)
        return cls(**{key: frozenset(values) for key, values in found.items()})


@dataclass(frozen=True)
class Plan:
    """The cells of one tier, each once; a discovery cell comes before the learner cells that need it."""

    cells: tuple[Cell, ...]


def make_plan(
    file: SuiteFile, tier_name: str, plugins: Plugins, seeds: int | None = None, only: Sequence[str] = ()
) -> Plan:
    """The cells of `tier_name`, for seeds 0 to `seeds` - 1 (the tier's number if None).

    Raises `SuiteError` or another `UserError` when a name that is selected does not exist or cannot be loaded.
    """
    suite = file.suite
    if tier_name not in suite.tiers:
        raise UnknownNameError("tier", tier_name, suite.tiers)
    tier = next(tier for name, tier in suite.tiers.items() if name == tier_name)
    selection = Selection.parse(only)
    chosen_seeds = _choose("seed", range(seeds or tier.seeds), selection.seed)
    backends = _choose("backend", suite.backends, selection.backend)
    methods = _choose("method", suite.methods, selection.method)
    _check_learners(file, plugins)
    task = _named(file, ("task",), lambda: plugins.task(suite.task))
    identity = TaskIdentity(task.name, task.version, dict(task.constants))
    cells: dict[str, Cell] = {}
    for backend_name in backends:
        location = ("backends", suite.backends.index(backend_name))
        found = _named(file, location, lambda: _capable_backend(plugins, backend_name, task))  # noqa: B023
        backend = _identify(found, plugins, file)
        _check_discoverer(file, tier, tier_name, backend_name, plugins)
        for method_name in methods:
            location = ("methods", suite.methods.index(method_name))
            method = _named(file, location, lambda: plugins.method(method_name))  # noqa: B023
            if method.learner not in LEARNER.learners:
                raise file.source.mistake(
                    location, f"its learner {method.learner!r} is none of {', '.join(LEARNER.learners)}"
                )
            for seed in chosen_seeds:
                cell = _learner_cell(file, plugins, tier, tier_name, identity, backend, method, seed)
                if cell.discovery:
                    cells[cell.discovery.id] = cell.discovery
                cells[cell.id] = cell
    return Plan(tuple(sorted(cells.values(), key=lambda cell: isinstance(cell, LearnerCell))))


def _choose(kind: str, available: Sequence[Any], wanted: frozenset[Any]) -> list[Any]:
    for name in sorted(wanted):
        if name not in available:
            raise UnknownNameError(f"{kind} in --only", str(name), map(str, available))
    return [item for item in available if not wanted or item in wanted]


def _named(file: SuiteFile, location: Location, look_up: Callable[[], Any]) -> Any:
    try:
        return look_up()
    except SuiteError:
        raise
    except UserError as error:
        raise file.source.mistake(location, str(error)) from error


def _check_discoverer(file: SuiteFile, tier: Tier, tier_name: str, backend: str, plugins: Plugins) -> None:
    """Refuse a discoverer that does not exist or lacks a library, at the line that names it."""
    of_backend = file.suite.per_backend.get(backend, PerBackend())
    layers: list[tuple[Location, Mapping[str, Any]]] = [
        (("tiers", tier_name), tier.discovery),
        (("per_backend", backend), of_backend.discovery),
        ((), file.suite.discovery),
    ]
    for location, patch in layers:
        if "discoverer" in patch:
            _named(file, (*location, "discovery", "discoverer"), lambda: plugins.discoverer(patch["discoverer"]))  # noqa: B023
            return


def _check_learners(file: SuiteFile, plugins: Plugins) -> None:
    """Refuse a learner setting that none of the methods it stands for has: it would do nothing, without a word."""
    suite = file.suite
    learners = {name: plugins.methods[name].learner for name in suite.methods if name in plugins.methods}
    names = list(learners)
    layers: list[tuple[Location, Tier | PerBackend | PerMethod | Suite, Sequence[str]]] = [
        ((), suite, names),
        *((("tiers", name), tier, names) for name, tier in suite.tiers.items()),
        *((("per_backend", name), layer, names) for name, layer in suite.per_backend.items()),
        *(
            (("per_method", name), layer, [name] if name in learners else [])
            for name, layer in suite.per_method.items()
        ),
    ]
    for location, layer, methods in layers:
        reached = {learners[name] for name in methods}
        for key in layer.learner:
            owners = LEARNER.owners(key)
            if reached and reached.isdisjoint(owners):
                raise file.source.mistake(
                    (*location, "learner", key),
                    f"a setting of {' and '.join(owners)} methods, and {', '.join(methods)} "
                    f"{'is' if len(methods) == 1 else 'are'} none; leave it out, or add such a method",
                )


def _capable_backend(plugins: Plugins, name: str, task: Task) -> Backend:
    backend = plugins.backend(name)
    scene_maker(backend, task)  # raises for a robot that does not drive where the task does
    return backend


def _identify(backend: Backend, plugins: Plugins, file: SuiteFile) -> BackendIdentity:
    per_backend = file.suite.per_backend.get(backend.name, PerBackend())
    return BackendIdentity(
        backend.name, plugins.owners[backend.name].version, module_versions(backend.modules), per_backend.options
    )


def module_versions(modules: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that provide `modules`, without importing them."""
    if not (tops := {module.partition(".")[0] for module in modules}):
        return {}
    providers = importlib.metadata.packages_distributions()
    names = sorted({name for top in tops for name in providers.get(top, ())})
    return {name: importlib.metadata.version(name) for name in names}


def _learner_cell(
    file: SuiteFile, plugins: Plugins, tier: Tier, tier_name: str, task: TaskIdentity, backend: BackendIdentity,
    method: Method, seed: int,
) -> LearnerCell:  # fmt: skip
    suite, code = file.suite, __version__
    of_backend = suite.per_backend.get(backend.name, PerBackend())
    layers = (suite, of_backend, suite.per_method.get(method.name, PerMethod()), tier)
    discovery = None
    if method.matrix == "discovered":
        settings = DiscoveryPatch(plugins.discoverers).resolve([suite.discovery, of_backend.discovery, tier.discovery])
        discovery = DiscoveryCell(code, task, backend, seed if tier_name == OWN_GRAPH_TIER else 0, settings)
    return LearnerCell(
        code,
        task,
        backend,
        method,
        seed,
        tier.env_steps,
        LEARNER.resolve(method.learner, [layer.learner for layer in layers]),
        EVALUATION.resolve([layer.evaluation for layer in layers]),
        discovery,
    )
