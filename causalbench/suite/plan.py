"""The plan: the cells that a suite asks for."""

from __future__ import annotations

import functools
import importlib.metadata
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

from causalbench._version import __version__
from causalbench.core.discovery.registry import Discoverer
from causalbench.core.learners.methods import Method
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability, lacking
from causalbench.digests import canonical_json
from causalbench.errors import SuiteError, UnknownNameError, UserError
from causalbench.plugins.backends import Backend
from causalbench.plugins.manager import Plugins
from causalbench.plugins.venues import Venue, venue_of
from causalbench.suite.cells import BackendIdentity, Cell, DiscoveryCell, LearnerCell, TaskIdentity
from causalbench.suite.grid import DISCOVERER, DONOR, DONOR_TASK, NAMES, OWN, TASK, Combination, combinations, layer_of
from causalbench.suite.hypotheses import Hypothesis, Statement
from causalbench.suite.positions import Location
from causalbench.suite.schema import DiscoveryLayer, PerBackend, PerMethod, SuiteFile, TierBackend
from causalbench.suite.sections import Patch
from causalbench.suite.selection import Selection, choose
from causalbench.suite.task_identity import task_identity

MAX_CELLS = 10_000


@dataclass(frozen=True)
class Plan:
    """The cells of one tier, each once; a discovery cell comes before the learner cells that need it.

    `impossible` says of a cell's id, in a sentence, why its backend cannot run the task, or its worlds cannot do what
    the cell asks of them: the cell will be skipped. `statement` is what the tier sets out to show.
    """

    cells: tuple[Cell, ...]
    statement: Statement
    impossible: Mapping[str, str] = field(default_factory=dict)

    def up_to(self, seeds: int) -> Plan:
        """The part of the plan that is of the first `seeds` seeds of its statement."""
        chosen = set(self.statement.seeds[:seeds])
        return replace(self, cells=tuple(cell for cell in self.cells if cell.seed in chosen))


def make_plan(
    file: SuiteFile, tier_name: str, plugins: Plugins, seeds: int | None = None, only: Sequence[str] = ()
) -> Plan:
    """The cells of `tier_name`, for `seeds` seeds from the suite's first one on (the tier's number if None).

    Raises `SuiteError` or another `UserError` when a name that is selected does not exist or cannot be loaded.
    """
    suite, selection = file.suite, Selection.parse(only)
    if tier_name not in suite.tiers:
        raise UnknownNameError("tier", tier_name, suite.tiers)
    planner = _Planner(file, tier_name, plugins)
    first = suite.first_seed
    all_seeds = range(first, first + (seeds or planner.tier.seeds))
    chosen_seeds = choose("seed", all_seeds, selection.seed)
    backends = choose("backend", suite.backends_in(planner.tier), selection.backend)
    methods = [planner.method(name) for name in choose("method", suite.methods, selection.method)]
    planner.check_number(len(backends) * max(1, len(methods)) * len(chosen_seeds))
    cells: dict[str, Cell] = {}
    impossible: dict[str, str] = {}
    for name in backends:
        for cell in planner.cells(name, methods, chosen_seeds):
            cells[cell.id] = cell
            if why := planner.beyond(cell):
                impossible[cell.id] = why
    ordered = tuple(sorted(cells.values(), key=lambda cell: isinstance(cell, LearnerCell)))
    planner.check_hypotheses(ordered)
    return Plan(ordered, planner.statement(all_seeds), impossible)


class _Played(NamedTuple):
    task: StageTask
    identity: TaskIdentity
    venue: Venue


class _Planner:
    """What the cells of one tier have in common."""

    def __init__(self, file: SuiteFile, tier_name: str, plugins: Plugins) -> None:
        self.file, self.suite, self.plugins = file, file.suite, plugins
        self.tier_name = tier_name
        self.tier = next(tier for name, tier in file.suite.tiers.items() if name == tier_name)
        self._tasks: dict[str, _Played] = {}
        self._can: dict[tuple[str, str], frozenset[Capability]] = {}  # task, backend -> what worlds can do
        self._backends: dict[tuple[str, str], tuple[BackendIdentity, str]] = {}
        self.task(self.suite.task, ("task",))

    def task(self, name: str, location: Location) -> _Played:
        """The task `name`, which stands at `location`."""
        if name not in self._tasks:
            task: StageTask = self._named(location, partial(self.plugins.task, name))
            self._tasks[name] = _Played(task, self._named(location, partial(task_identity, task)), venue_of(task))
        return self._tasks[name]

    def _task_in(self, combination: Combination, donor: bool = False) -> _Played:
        """The task of a combination, or the one whose discovery gives it its graph."""
        for key in (DONOR_TASK, TASK) if donor else (TASK,):
            if combination.get(key, OWN) != OWN:
                return self.task(combination[key], ("grid", key))
        return self.task(self.suite.task, ("task",))

    def check_number(self, of_each_combination: int) -> None:
        """Refuse a plan that nobody can run. Raises `SuiteError`."""
        grid = self.suite.grid_in(self.tier)
        number = of_each_combination * math.prod(map(len, grid.values()))
        if number > MAX_CELLS:
            raise self.file.source.mistake(("grid",) if grid else (), f"{number} cells; the most is {MAX_CELLS}")

    def statement(self, seeds: Sequence[int]) -> Statement:
        """What the tier sets out to show with `seeds`."""
        backends = self.suite.backends_in(self.tier)
        hypotheses = tuple(Hypothesis.parse(text).text for text in self.suite.hypotheses)
        return Statement(self.suite.name, self.tier_name, hypotheses, backends, tuple(seeds))

    def check_hypotheses(self, cells: Iterable[Cell]) -> None:
        """Refuse a hypothesis about a method that `cells` have at several points of the grid. Raises `SuiteError`."""
        points: dict[str, set[str]] = {}
        for cell in cells if self.suite.hypotheses else ():
            if isinstance(cell, LearnerCell):
                points.setdefault(cell.method.name, set()).add(canonical_json(cell.grid_point))
        for index, text in enumerate(self.suite.hypotheses):
            found = Hypothesis.parse(text)
            for name in (found.left, found.right):
                if len(points.get(name, ())) > 1:
                    several = f"the grid has {name!r} at several points; a hypothesis needs one of each method"
                    raise self.file.source.mistake(("hypotheses", index), several)

    def method(self, name: str) -> Method:
        """The method `name`, whose learner has all that it needs."""
        method = self.plugins.methods[name]
        self._named(("methods", self.suite.methods.index(name)), partial(self.plugins.learner, method.learner))
        return method

    def backend(self, name: str, played: _Played, combination: Combination) -> BackendIdentity:
        """The backend `name`, which the suite or `combination` names, as it enters a cell of the task `played`."""
        key = (played.identity.name, name)
        if key not in self._backends:
            self._backends[key] = self._find_backend(name, played.venue, combination)
        return self._backends[key][0]

    def _find_backend(self, name: str, venue: Venue, combination: Combination) -> tuple[BackendIdentity, str]:
        """The backend, and why it cannot run the task, "" if it can."""
        location: Location = ("tiers", self.tier_name, "backends", name)
        if name not in self.suite.backends_in(self.tier):
            location = ("grid", DONOR)
        elif not self.tier.backends:
            location = ("backends", self.suite.backends.index(name))
        found: Backend = self._named(location, partial(self.plugins.backend, name))
        options = self.suite.per_backend.get(name, PerBackend()).options
        version = self.plugins.owners[name].version
        modules = module_versions((*found.modules, *venue.modules))
        self._named(("per_backend", name, "options"), partial(venue.check_options, found, options))
        return BackendIdentity(name, version, modules, options), venue.refusal(found, options)

    def beyond(self, cell: Cell) -> str:
        """What the cell asks of a backend or of worlds that cannot do it, in a sentence; "" if they can."""
        name, key = cell.backend.name, (cell.task.name, cell.backend.name)
        if reason := self._backends[key][1]:
            return reason
        if key not in self._can:
            venue = self._tasks[cell.task.name].venue
            self._can[key] = venue.capabilities(self.plugins.backends[name], cell.backend.options)
        can = self._can[key]
        needs = requirements(cell, self.plugins.discoverers)
        lacked = [lacking(need, purpose, name, cell.task.name) for need, purpose in needs if need not in can]
        if isinstance(cell, LearnerCell) and cell.discovery and (foreign := self._foreign(cell, cell.discovery)):
            return foreign
        if isinstance(cell, LearnerCell) and cell.discovery and not lacked:
            return self.beyond(cell.discovery)
        return next(iter(lacked), "")

    def _foreign(self, cell: LearnerCell, donor: DiscoveryCell) -> str:
        """Why the graph of another task cannot be that of the cell's, in a sentence; "" if it can."""
        one, other = (self._tasks[name].task for name in (cell.task.name, donor.task.name))
        for what in ("actions", "n_stages", "terms"):
            if getattr(one, what) != getattr(other, what):
                return f"task {one.name!r} cannot use a causal graph of {other.name!r}: their {what} differ"
        return ""

    def cells(self, backend: str, methods: Sequence[Method], seeds: Sequence[int]) -> Iterator[Cell]:
        """All cells on one backend; some more than once."""
        for combination in combinations(self.suite.grid_in(self.tier)):
            if not self.suite.methods:
                yield from (self._discovery(backend, seed, combination) for seed in seeds)
            for method in methods:
                first = self._learner(backend, method, seeds[0], combination)
                for seed in seeds:  # of which all but the seed and the graph is the same
                    own = first.discovery and self._discovery(backend, seed, combination, method)
                    cell = replace(first, seed=seed, discovery=own)
                    if cell.discovery:
                        yield cell.discovery
                    yield cell

    def _discovery(self, user: str, seed: int, combination: Combination, method: Method | None = None) -> DiscoveryCell:
        """The discovery whose graph `seed` uses on the backend `user`, by the discoverer that `method` may name."""
        named = method.discoverer if method else ""
        if named:
            combination = {key: value for key, value in combination.items() if key != DISCOVERER}
        name, played = combination.get(DONOR, user), self._task_in(combination, donor=True)
        backend, section = self.backend(name, played, combination), self.file.sections.discovery
        layers: list[DiscoveryLayer] = [self.suite, self._of_backend(name), self.tier, self._in_tier(name)]
        patches = [*(layer.discovery for layer in layers), layer_of(combination)["discovery"]]
        location = self._discoverer_location(name, combination)
        if method and named:
            location = ("methods", self.suite.methods.index(method.name))
            patches.append({"discoverer": named})
        settings = self._named(location, partial(section.resolve, patches))
        self._named(location, partial(self.plugins.discoverer, settings.discoverer))
        grid_point = _reaching(combination, "discovery", partial(section.reaches, subject=settings.discoverer))
        if TASK in combination or DONOR_TASK in combination:
            grid_point = {TASK: played.identity.name, **grid_point}
        own = self.suite.graphs_in(self.tier) == "per_seed"
        return DiscoveryCell(
            __version__, played.identity, backend, seed if own else self.suite.first_seed, settings, grid_point
        )

    def _learner(self, backend: str, method: Method, seed: int, combination: Combination) -> LearnerCell:
        sections, patches = self.file.sections, self._learner_patches(backend, method.name, combination)
        played = self._task_in(combination)
        asks = method.matrix in ("discovered", "oracle")
        asked = self._discovery(backend, seed, combination, method) if asks else None
        discovery = asked if method.matrix == "discovered" else None
        grid_point = _reaching(combination, "learner", partial(sections.learner.reaches, subject=method.learner))
        grid_point |= _reaching(combination, "evaluation", lambda key: True)
        if TASK in combination:
            grid_point = {TASK: combination[TASK], **grid_point}
        if method.matrix == "oracle":
            grid_point |= _reaching(combination, "discovery", lambda key: key == "action_repeat")
        return LearnerCell(
            code=__version__,
            task=played.identity,
            backend=self.backend(backend, played, combination),
            method=method,
            seed=seed,
            env_steps=self._in_tier(backend).env_steps or self.tier.env_steps or 0,
            learner=self._named(("learner",), partial(sections.learner.resolve, method.learner, patches["learner"])),
            evaluation=sections.evaluation.resolve(patches["evaluation"]),
            discovery=discovery,
            action_repeat=asked.settings.action_repeat if asked and not discovery else 1,
            grid_point={**grid_point, **(_of_discovery(discovery, combination) if discovery else {})},
        )

    def _learner_patches(self, backend: str, method: str, combination: Combination) -> dict[str, list[Patch]]:
        """Section -> its patches, the last one winning."""
        of_method, in_tier = self.suite.per_method.get(method, PerMethod()), self._in_tier(backend)
        layers = [self.suite, self._of_backend(backend), of_method, self.tier, in_tier]
        last = layer_of(combination)
        return {name: [*(getattr(layer, name) for layer in layers), last[name]] for name in ("learner", "evaluation")}

    def _of_backend(self, name: str) -> PerBackend:
        return self.suite.per_backend.get(name, PerBackend())

    def _in_tier(self, name: str) -> TierBackend:
        return (self.tier.backends or {}).get(name, TierBackend())

    def _discoverer_location(self, backend: str, combination: Combination) -> Location:
        """Where the discoverer of a backend is named."""
        if DISCOVERER in combination:
            return ("grid", DISCOVERER)
        layers: list[tuple[Location, DiscoveryLayer]] = [
            (("tiers", self.tier_name, "backends", backend), self._in_tier(backend)),
            (("tiers", self.tier_name), self.tier),
            (("per_backend", backend), self._of_backend(backend)),
            ((), self.suite),
        ]
        named = (place for place, layer in layers if "discoverer" in layer.discovery)
        return (*next(named, ()), "discovery", "discoverer")

    def _named(self, location: Location, look_up: Callable[[], Any]) -> Any:
        """What `look_up` finds; its error names the place in the file."""
        try:
            return look_up()
        except SuiteError:
            raise
        except (UserError, ValueError) as error:  # ValueError: the check of a stranger's settings
            raise self.file.source.mistake(location, str(error)) from error


def _of_discovery(discovery: DiscoveryCell, combination: Combination) -> dict[str, Any]:
    """What of `combination` reaches a method by the discovery whose graph it uses."""
    donors = {key: combination[key] for key in (DONOR_TASK, DONOR) if key in combination}
    return {**{key: value for key, value in discovery.grid_point.items() if key != TASK}, **donors}


def requirements(cell: Cell, discoverers: Mapping[str, Discoverer]) -> Iterator[tuple[Capability, str]]:
    """What the worlds of a cell itself must be able to do beyond being played, each with what for."""
    if isinstance(cell, DiscoveryCell):
        name = cell.settings.discoverer
        yield from ((capability, f"discoverer {name!r}") for capability in sorted(discoverers[name].requires))
        if cell.settings.oracle_states:
            yield Capability.RESTORE, "the oracle (`oracle_states`)"
        return
    if cell.method.matrix == "oracle":
        yield Capability.RESTORE, f"method {cell.method.name!r}, which asks the oracle,"
    if cell.method.control != "none":
        yield Capability.EXPERT, f"method {cell.method.name!r}, whose control an expert must solve,"


def _reaching(combination: Combination, section: str, reaches: Callable[[str], bool]) -> dict[str, Any]:
    """The settings of `combination` in `section` that do something."""
    prefix = f"{section}."
    return {
        key: value
        for key, value in combination.items()
        if key.startswith(prefix) and key not in NAMES and reaches(key.removeprefix(prefix))
    }


def module_versions(modules: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that provide `modules`, without importing them."""
    if not (tops := {module.partition(".")[0] for module in modules}):
        return {}
    names = sorted({name for top in tops for name in _providers().get(top, ())})
    return {name: importlib.metadata.version(name) for name in names}


@functools.cache
def _providers() -> Mapping[str, list[str]]:
    """Top-level module -> the distributions that provide it; read once, since it takes a second."""
    return importlib.metadata.packages_distributions()
