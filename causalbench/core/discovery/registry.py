"""What a discovery method is: a function from one stage's problem to its graph. The table holds the built-in ones.

A plugin adds a row through `causalbench_discoverers`; `DiscoverySettings.discoverer` chooses one by name.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, get_args

from causalbench.core.discovery.graph import StageGraph
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.tasks.task import Task

if TYPE_CHECKING:  # importing Gymnasium loads this table, which thus must not need Gymnasium
    from causalbench.core.discovery.samples.collect import Samples, StageSamples
    from causalbench.core.world.scene import Scene


SampleSet = Literal["random", "inference", "do"]
"""D_random, D_inference, and D_do of every action (with the set that stands for the placebos')."""
SAMPLE_SETS: frozenset[SampleSet] = frozenset(get_args(SampleSet))


class StageProblem(Protocol):
    """One stage of a task as a discoverer meets it. What it asks for is made then, and its control steps are counted.

    `seed` is the whole discovery's: derive generators from [seed, stage, a number of your own].
    """

    @property
    def task(self) -> Task:
        """The task."""

    @property
    def stage(self) -> int:
        """The stage, from 1."""

    @property
    def settings(self) -> DiscoverySettings:
        """All settings of this discovery."""

    @property
    def seed(self) -> int:
        """Seed of the discovery."""

    def samples(self) -> StageSamples:
        """The sets that the discoverer's row says it `reads`, collected on first use; the others are empty.

        A set is the same for every discoverer of equal seed.
        """

    def scene(self) -> Scene:
        """A simulator for queries of your own; every step of it counts. Raises `UserError` if there are only files."""

    def keep(self, name: str, samples: Samples) -> None:
        """Store samples that were taken from `scene` beside the others, and let them enter the graph's data hash."""

    def report(self, share: float, doing: str) -> None:
        """How far this stage is, in [0, 1], beyond collecting `samples`."""


@dataclass(frozen=True)
class Discoverer:
    """What `causalbench_discoverers` registers.

    `discover_stage` returns the graph of one stage; it raises `UndecidedStageError` when the data do not allow one.
    It imports heavy libraries when called, never before. `modules` are the optional imports that it needs and `extra`
    the pip requirement that installs them; `about` is a line for people. `reads` names the sets of Algorithm 1 that its
    samples have: others cost no environment step.
    """

    name: str
    discover_stage: Callable[[StageProblem], StageGraph]
    about: str
    modules: tuple[str, ...] = ()
    extra: str = ""
    reads: frozenset[SampleSet] = SAMPLE_SETS


def _from(module: str, function: str = "discover_stage") -> Callable[[StageProblem], StageGraph]:
    """A function of a module beside this one, imported when it is called."""

    def discover_stage(problem: StageProblem) -> StageGraph:
        found = getattr(importlib.import_module(f"causalbench.core.discovery.methods.{module}"), function)
        graph: StageGraph = found(problem)
        return graph

    return discover_stage


RANDOM: frozenset[SampleSet] = frozenset(("random",))
OBSERVED: frozenset[SampleSet] = frozenset(("random", "inference"))
CAUSAL_LEARN = (("causallearn",), "causalbench-robotics[causal-learn]")

DISCOVERERS: Mapping[str, Discoverer] = {
    row.name: row
    for row in (
        Discoverer("kl", _from("kl.method"), "KL of reward models with and without the action (the paper)"),
        Discoverer("paired", _from("paired"), "effect sizes from paired interventions, until each edge is decided"),
        Discoverer("sufficient", _from("sufficient"), "as paired, then as few of the causes as finish the stage"),
        Discoverer("permutation", _from("permutation"), "permutation test on paired interventions"),
        Discoverer("cmi", _from("cmi"), "conditional mutual information (CausalMoMa)", reads=OBSERVED),
        Discoverer("fisher_z", _from("independence", "by_fisher_z"), "partial correlation", *CAUSAL_LEARN, RANDOM),
        Discoverer("kci", _from("independence", "by_kci"), "kernel independence test", *CAUSAL_LEARN, RANDOM),
    )
}
