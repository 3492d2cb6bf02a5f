"""The suite file: what may stand in it, and errors that name file, line, key and the nearest valid name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.errors import UnknownNameError
from causalbench.formats import SuiteFormat
from causalbench.plugins.manager import Plugins
from causalbench.suite.grid import DISCOVERER, NAMES, TASK, Grid, layer_of
from causalbench.suite.hypotheses import Hypothesis
from causalbench.suite.messages import as_json, explain, guess, worst
from causalbench.suite.positions import Location, PositionedYaml, Source
from causalbench.suite.sections import SECTIONS, Sections

MAX_SEEDS, MAX_SEED, MAX_STEPS, MAX_HYPOTHESES = 10_000, 10**9, 10**12, 100

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]+$", max_length=64)]
Graphs = Literal["per_seed", "shared"]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Layer(_Model):
    """Settings by name, of the learners and of their evaluation."""

    learner: dict[str, Any] = {}  # of every learner that has the key, or NAME: {...} for one learner
    evaluation: dict[str, Any] = {}  # when and how learners are evaluated


class PerMethod(Layer):
    """What differs for one method."""


class DiscoveryLayer(Layer):
    """Settings by name, of causal discovery, too."""

    discovery: dict[str, Any] = {}  # of every discoverer, and NAME: {...} for one discoverer's own


class PerBackend(DiscoveryLayer):
    """What differs for one backend; `options` go to its `make`."""

    options: dict[str, str | int | float | bool] = {}  # keyword arguments of the backend's `make`


class TierBackend(DiscoveryLayer):
    """What differs for one backend in one tier."""

    env_steps: int | None = Field(default=None, gt=0, le=MAX_STEPS)  # of training there, in place of the tier's


class Tier(DiscoveryLayer):
    """How much to run: how many `seeds`, `env_steps` of training each.

    `grid` replaces the suite's, and so does `backends`, which says of each backend what differs there.
    """

    # The backends of this tier in place of the suite's, and what differs in each.
    backends: dict[str, TierBackend] | None = Field(default=None, min_length=1)
    seeds: int = Field(gt=0, le=MAX_SEEDS)  # how many, from `first_seed` on
    # Of training, in all worlds of a learner together; a suite without methods needs none.
    env_steps: int | None = Field(default=None, gt=0, le=MAX_STEPS)
    graphs: Graphs | None = None  # in place of the suite's
    grid: Grid | None = None  # in place of the suite's


class Suite(DiscoveryLayer):
    """A suite file. Later wins: preset, suite, `per_backend`, `per_method`, tier, backend in the tier, `grid`.

    `first_seed` is the first of the seeds that a tier runs, the others follow. `graphs` says whether they share one
    causal graph, the first seed's, or each discovers its own, which keeps seeds independent. A suite without methods
    asks for the graphs alone, each seed's. `hypotheses` are judged by a run's report before anything else.
    """

    version: SuiteFormat = Field(alias="schema")  # number of this format
    name: Name  # of the run folder
    task: str  # a registered task
    backends: tuple[str, ...] = Field(min_length=1)  # registered backends, each run by itself
    methods: tuple[str, ...]  # registered methods; empty: the causal graphs alone
    tiers: dict[Name, Tier] = Field(min_length=1)  # name of `--tier` -> how much to run
    # What the run sets out to show, such as `cmSAC > mSAC`: judged before anything else.
    hypotheses: tuple[str, ...] = Field(default=(), max_length=MAX_HYPOTHESES)
    first_seed: int = Field(default=0, ge=0, le=MAX_SEED)  # the tier's other seeds follow it
    # Whether each seed discovers its own graph; by default seeds share one where there are methods.
    graphs: Graphs | None = None
    grid: Grid = {}  # dotted key of a setting -> its values; every combination is run
    per_method: dict[str, PerMethod] = {}  # method -> what differs for it
    per_backend: dict[str, PerBackend] = {}  # backend -> what differs there

    def graphs_in(self, tier: Tier) -> Graphs:
        """Whether seeds share a graph in `tier`."""
        return tier.graphs or self.graphs or ("shared" if self.methods else "per_seed")

    def backends_in(self, tier: Tier) -> tuple[str, ...]:
        """The backends that `tier` runs."""
        return self.backends if tier.backends is None else tuple(tier.backends)

    def grid_in(self, tier: Tier) -> Grid:
        """The grid of `tier`, empty if there is none."""
        return self.grid if tier.grid is None else tier.grid


@dataclass(frozen=True)
class SuiteFile:
    """A valid suite, the file it came from, and what its settings sections mean."""

    suite: Suite
    source: Source
    sections: Sections


def load_suite(path: Path, plugins: Plugins) -> SuiteFile:
    """Read a suite file whose methods, learners and settings are those of `plugins`.

    Raises `SuiteError`. Task, backends and discoverers are looked up when a plan is made, which may need only some.
    """
    return check_suite(PositionedYaml(path), plugins)


def check_suite(source: Source, plugins: Plugins) -> SuiteFile:
    """The suite in `source`; see `load_suite`."""
    if not isinstance(source.data, dict):
        raise source.mistake((), "expected `key: value` lines; see suites/pure_manip.yaml for an example")
    try:
        suite = Suite.model_validate_json(as_json(source.data), strict=True)
    except pydantic.ValidationError as error:
        first = worst(error)
        raise source.mistake(_in_file(first["loc"]), explain(first, _known_keys(first["loc"][:-1]))) from None
    _check_names(suite, source)
    _check_hypotheses(suite, source)
    learners = _learners(suite, source, plugins)
    file = SuiteFile(suite, source, Sections.of(plugins, dict.fromkeys(learners.values())))
    _check_sections(file, learners)
    methods = [plugins.methods[name] for name in learners]
    _check_discoverers(file, {method.discoverer for method in methods})
    _check_graphs(file, {method.matrix for method in methods})
    _check_budgets(file)
    return file


def _check_names(suite: Suite, source: Source) -> None:
    backends = dict.fromkeys(suite.backends + sum((suite.backends_in(tier) for tier in suite.tiers.values()), ()))
    for key, listed, names, overrides in (
        ("backends", suite.backends, tuple(backends), suite.per_backend),
        ("methods", suite.methods, suite.methods, suite.per_method),
    ):
        for index, name in enumerate(listed):
            if name in listed[:index]:
                raise source.mistake((key, index), f"{name!r} is listed twice")
        for name in overrides:
            if name not in names:
                unknown = f"not one of this suite's: {', '.join(names)}.{guess(name, names)}"
                raise source.mistake((f"per_{key[:-1]}", name), unknown)


def _check_hypotheses(suite: Suite, source: Source) -> None:
    seen: set[tuple[frozenset[str], bool]] = set()
    for index, text in enumerate(suite.hypotheses):
        try:
            found = Hypothesis.parse(text)
        except ValueError as error:
            raise source.mistake(("hypotheses", index), str(error)) from None
        for name in (found.left, found.right):
            if name not in suite.methods:
                unknown = f"{name!r} is not one of this suite's: {', '.join(suite.methods)}."
                raise source.mistake(("hypotheses", index), unknown + guess(name, suite.methods))
        key = frozenset((found.left, found.right)), found.within is None
        if key in seen:
            raise source.mistake(("hypotheses", index), f"{text!r}: these two methods are compared in a line above")
        seen.add(key)


def _learners(suite: Suite, source: Source, plugins: Plugins) -> dict[str, str]:
    """The suite's methods, each with its learner."""
    found = {}
    for index, name in enumerate(suite.methods):
        if name not in plugins.methods:
            raise source.mistake(("methods", index), str(UnknownNameError("method", name, plugins.methods)))
        learner = plugins.methods[name].learner
        if learner not in plugins.learners:
            unknown = UnknownNameError("learner", learner, plugins.learners)
            raise source.mistake(("methods", index), f"method {name!r} trains with an {unknown}")
        found[name] = learner
    return found


def _check_sections(file: SuiteFile, learners: Mapping[str, str]) -> None:
    """Refuse a setting that does not exist, has a wrong value, or would do nothing."""
    for location, layer, methods in _layers(file.suite):
        reached = {name: learners[name] for name in methods}
        for section in SECTIONS:
            if found := file.sections.problem(section, getattr(layer, section, {}), reached):
                raise file.source.mistake((*location, section, *found[0]), found[1])
    for place, grid in _grids(file.suite):
        _check_grid(file, place, grid, learners)


def _check_discoverers(file: SuiteFile, of_methods: Set[str]) -> None:
    """Refuse settings of a discoverer that nothing in the suite chooses, nor any of its methods by themselves."""
    layers = [(place, layer.discovery) for place, layer, _ in _layers(file.suite) if isinstance(layer, DiscoveryLayer)]
    grids = list(_grids(file.suite))
    chosen = {patch["discoverer"] for _, patch in layers if "discoverer" in patch} | of_methods - {""}
    chosen |= {name for _, grid in grids for name in grid.get(DISCOVERER, ())}
    if "discoverer" not in file.suite.discovery:
        chosen.add(DiscoverySettings().discoverer)
    named = [((*place, "discovery", name), name) for place, patch in layers for name in patch]
    named += [((*place, key), key.split(".")[1]) for place, grid in grids for key in grid if key.count(".") > 1]
    for location, name in named:
        if name in file.sections.discovery.own and name not in chosen:
            raise file.source.mistake(
                location,
                f"settings of the discoverer {name!r}, and this suite discovers with {', '.join(sorted(chosen))}; "
                f"leave it out, or say discoverer: {name}",
            )


def _check_graphs(file: SuiteFile, matrices: Set[str]) -> None:
    """Refuse to say who shares a graph where no method needs a discovered one."""
    if not matrices or "discovered" in matrices:
        return
    asking: list[tuple[Location, Suite | Tier]] = [((), file.suite)]
    asking += [(("tiers", name), tier) for name, tier in file.suite.tiers.items()]
    for location, layer in asking:
        if layer.graphs is not None:
            of_none = f"no graph is discovered for {', '.join(file.suite.methods)}; leave it out"
            raise file.source.mistake((*location, "graphs"), of_none)


def _layers(suite: Suite) -> Iterator[tuple[Location, Layer, Sequence[str]]]:
    """(where it stands, layer, methods that it is for) of everything that holds settings."""
    yield (), suite, suite.methods
    for tier_name, tier in suite.tiers.items():
        yield ("tiers", tier_name), tier, suite.methods
        for backend, in_tier in (tier.backends or {}).items():
            yield ("tiers", tier_name, "backends", backend), in_tier, suite.methods
    for backend, of_backend in suite.per_backend.items():
        yield ("per_backend", backend), of_backend, suite.methods
    for method, of_method in suite.per_method.items():
        yield ("per_method", method), of_method, [method]


def _grids(suite: Suite) -> Iterator[tuple[Location, Grid]]:
    yield ("grid",), suite.grid
    for name, tier in suite.tiers.items():
        yield ("tiers", name, "grid"), tier.grid or {}


def _check_grid(file: SuiteFile, place: Location, grid: Grid, learners: Mapping[str, str]) -> None:
    for key, values in grid.items():
        section, _, rest = key.partition(".")
        if key != TASK and (section not in SECTIONS or not rest):
            expected = ", ".join(f"{name}.KEY" for name in SECTIONS)
            raise file.source.mistake((*place, key), f"expected {expected} or {TASK}")
        for index, value in enumerate(values):
            if value in values[:index]:
                raise file.source.mistake((*place, key, index), f"{value!r} is listed twice")
            if key in NAMES:
                if not isinstance(value, str):
                    kind = "backend" if key.endswith("backend") else "task"
                    raise file.source.mistake((*place, key, index), f"expected the name of a {kind}, got {value!r}")
                continue
            patch = layer_of({key: value})[section]
            if found := file.sections.problem(section, patch, learners):
                raise file.source.mistake((*place, key, index), found[1])


def _check_budgets(file: SuiteFile) -> None:
    for name, tier in file.suite.tiers.items():
        if file.suite.methods and tier.env_steps is None:
            raise file.source.mistake(("tiers", name, "env_steps"), "this key is missing: how long to train")


def _in_file(location: Location) -> Location:
    """Pydantic marks a wrong dictionary key by a last part "[key]", which stands nowhere in the file."""
    return location[:-1] if location and location[-1] == "[key]" else location


def _known_keys(parent: Location) -> list[str]:
    """The keys that may stand below `parent`."""
    below: dict[str, type[_Model]] = {"tiers": Tier, "per_method": PerMethod, "per_backend": PerBackend}
    model = below.get(str(parent[0]), Suite) if parent else Suite
    if parent[2:3] == ("backends",):
        model = TierBackend
    return [field.alias or name for name, field in model.model_fields.items()]
