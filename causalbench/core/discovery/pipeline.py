"""Discovery as a whole: for every stage let a discoverer decide, and make one graph of what it found."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from causalbench._version import __version__
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph, StageGraph, declared_matrix
from causalbench.core.discovery.registry import Discoverer
from causalbench.core.discovery.samples.collection import Collection
from causalbench.core.discovery.samples.streams import Recipe, SampleStore, Stream
from causalbench.core.discovery.samples.transitions import Samples, StageSamples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.staged.worlds import MakeWorlds, Origin, Worlds
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import DiscovererError, LayoutDrawError, UndecidedStageError, UnknownNameError, UserError

Progress = Callable[[float, str], None]

COLLECT_SHARE = 0.7
"""Share of a stage's progress bar that collecting takes; for people only."""


def discover(
    task: StageTask,
    make_worlds: MakeWorlds,
    settings: DiscoverySettings,
    seed: int,
    on_progress: Progress,
    *,
    discoverers: Mapping[str, Discoverer] = DISCOVERERS,
    cores: int = 1,
    store: SampleStore | None = None,
) -> CausalGraph:
    """Discover the causal matrices of every stage of `task` by `settings.discoverer`; deterministic in `seed`.

    `on_progress(share done, what is being done)` is called often. The graph counts every env step taken, those of
    samples that `store` already had included. `cores` processes collect; the result does not depend on their number.
    Raises `UnknownNameError` for a discoverer that is not among `discoverers`.
    """
    with closing(make_worlds()) as world:
        recipe = Recipe(task, settings, seed, world.origin, make_worlds, store)
        return _discover(recipe, recipe.prepared(world), on_progress, discoverers, cores)


def discover_from_samples(
    task: StageTask,
    store: SampleStore,
    origin: Origin,
    settings: DiscoverySettings,
    seed: int,
    on_progress: Progress,
    *,
    discoverers: Mapping[str, Discoverer] = DISCOVERERS,
) -> CausalGraph:
    """As `discover`, on samples from `origin` that `store` kept, without a simulator: equal settings, equal graph."""
    return _discover(Recipe(task, settings, seed, origin, None, store), None, on_progress, discoverers, 1)


@dataclass
class _Problem:
    """What a discoverer sees of one stage: a `StageProblem`."""

    recipe: Recipe
    stage: int
    collection: Collection
    own_world: Worlds | None
    report: Progress
    collected: StageSamples | None = None
    kept: tuple[Samples, ...] = ()

    @property
    def task(self) -> StageTask:
        return self.recipe.task

    @property
    def terms(self) -> tuple[str, ...]:
        return self.task.stage_terms(self.stage, discoverable_only=True)

    @property
    def settings(self) -> DiscoverySettings:
        return self.recipe.settings

    @property
    def options(self) -> Any:
        return self.recipe.settings.options

    @property
    def seed(self) -> int:
        return self.recipe.seed

    def samples(self) -> StageSamples:
        if self.collected is None:
            self.collected = self.collection.stage(self.stage)
        return self.collected

    def world(self) -> Worlds:
        if self.own_world is None:
            raise UserError(
                f"discoverer {self.settings.discoverer!r} asks the simulator, so it cannot work on files; "
                "run it without --data"
            )
        return self.own_world

    def walk(self, rng: np.random.Generator) -> Walk:
        settings = self.settings
        return Walk(self.world(), self.stage, rng, settings.sequence_length, settings.action_repeat)

    def keep(self, name: str, samples: Samples) -> None:
        self.kept += (samples,)
        if self.recipe.store:
            about = self.recipe.about(Stream(self.stage, name, -1, len(samples), None))
            self.recipe.store.save(about, samples, self.task)


def _discover(
    recipe: Recipe,
    world: Worlds | None,
    on_progress: Progress,
    discoverers: Mapping[str, Discoverer],
    cores: int,
) -> CausalGraph:
    if recipe.settings.discoverer not in discoverers:
        raise UnknownNameError("discoverer", recipe.settings.discoverer, discoverers)
    discoverer = discoverers[recipe.settings.discoverer]
    recipe = replace(recipe, settings=discoverer.complete(recipe.settings), reads=discoverer.reads)
    board = _Board(recipe.task.n_stages, on_progress)
    collection = Collection(recipe, cores, board.on_collected)
    try:
        stages, digests = _decide_all(discoverer, recipe, collection, world, board)
    finally:
        collection.close()
    return CausalGraph(
        task=recipe.task.name,
        task_version=recipe.task.version,
        origin="discovered",
        stages=stages,
        columns=discoverer.evidence,
        env_steps=sum(collection.env_steps.values()) + (world.env_steps if world else 0),
        provenance=_provenance(recipe, digests),
    )


def _decide_all(
    discoverer: Discoverer, recipe: Recipe, collection: Collection, world: Worlds | None, board: _Board
) -> tuple[tuple[StageGraph, ...], list[str]]:
    """The graphs of all stages, and the digests of all samples that they are from."""
    graphs, digests = list[StageGraph](), list[str]()
    for stage in range(1, recipe.task.n_stages + 1):
        problem = _Problem(recipe, stage, collection, world, partial(board.on_report, stage))
        graphs.append(_decide(discoverer, problem))
        board.on_report(stage, 1.0, "decided")
        digests += [samples.digest() for samples in (*problem.kept, problem.collected) if samples]
    stages = tuple(discoverer.finish(graphs, recipe.settings) if discoverer.finish else graphs)
    for found in stages:
        discoverer.check(found)
    return stages, digests


def _provenance(recipe: Recipe, digests: Sequence[str]) -> dict[str, Any]:
    packages = {name: version(name) for name in ("numpy", "scipy", "torch")}
    return {
        **asdict(recipe.origin),
        "seed": recipe.seed,
        "settings": asdict(recipe.settings),
        "data_sha256": hashlib.sha256("".join(digests).encode()).hexdigest(),
        "versions": {"causalbench": __version__, "python": sys.version.split()[0], **packages},
    }


def _decide(discoverer: Discoverer, problem: _Problem) -> StageGraph:
    """What the discoverer found, with notes on its data; the declared graph where it could decide nothing."""
    task, stage = problem.task, problem.stage
    terms = task.stage_terms(stage, discoverable_only=True)
    try:
        graph = discoverer.discover_stage(problem)
        if not isinstance(graph, StageGraph):
            raise DiscovererError(f"discoverer {discoverer.name!r}: expected a StageGraph, got {graph!r}")
    except (LayoutDrawError, UndecidedStageError) as error:
        note = f"not discovered, the declared graph stands in: {error}"
        none = np.zeros(len(terms), dtype=bool)
        return StageGraph(stage, task.actions, terms, declared_matrix(task, stage, terms), testable=none, notes=(note,))
    constant = () if graph.testable is None else [t for t, can in zip(terms, graph.testable, strict=True) if not can]
    notes = tuple(f"{term} never varied: untestable, its column is the declared graph's" for term in constant)
    return replace(
        graph,
        undecided_as=problem.settings.undecided,
        notes=graph.notes + (problem.collected.notes if problem.collected else ()) + notes,
    )


class _Board:
    """How far all stages are, as one share: what was collected of each, and what its discoverer reports."""

    def __init__(self, n_stages: int, on_progress: Progress) -> None:
        self.on_progress = on_progress
        self.collected, self.reported = np.full(n_stages, np.nan), np.zeros(n_stages)

    def on_collected(self, stage: int, share: float) -> None:
        """`share` of the stage's samples are there."""
        self.collected[stage - 1] = share
        self._show(stage, "collecting")

    def on_report(self, stage: int, share: float, doing: str) -> None:
        """The discoverer is this far beyond collecting."""
        self.reported[stage - 1] = share
        self._show(stage, doing)

    def _show(self, stage: int, doing: str) -> None:
        both = COLLECT_SHARE * self.collected + (1 - COLLECT_SHARE) * self.reported
        shares = np.where(np.isnan(self.collected), self.reported, both)
        self.on_progress(float(shares.mean()), f"stage {stage}: {doing}")
