"""What a discovery method is: a function from one stage's problem to its graph, with settings and evidence of its own.

Built-in and a stranger's are registered alike, through `causalbench_discoverers`; the setting `discoverer` chooses one
by its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.edges import RESERVED
from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.settings import PRESETS, SHARED, DiscoverySettings, NoSettings
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability
from causalbench.errors import DiscovererError, UnknownNameError, UserError

if TYPE_CHECKING:  # importing Gymnasium loads this module, which thus must not need Gymnasium
    from causalbench.core.discovery.samples.transitions import Samples, StageSamples
    from causalbench.core.discovery.truth.counterfactual import Walk
    from causalbench.core.staged.worlds import Worlds


SampleSet = Literal["random", "inference", "do"]
"""D_random, D_inference, and D_do of every action (with the set that stands for the placebos')."""
SAMPLE_SETS: frozenset[SampleSet] = frozenset(get_args(SampleSet))


class StageProblem(Protocol):
    """One stage of a task, as a discoverer gets it. Samples and worlds are made on request, and their steps count.

    `seed` is the whole discovery's: derive generators from [seed, stage, a number of your own].
    """

    @property
    def task(self) -> StageTask:
        """The task."""

    @property
    def stage(self) -> int:
        """The stage, from 1."""

    @property
    def settings(self) -> DiscoverySettings:
        """The settings that all discoverers share."""

    @property
    def options(self) -> Any:
        """The discoverer's own settings: a record of the type that it registered."""

    @property
    def seed(self) -> int:
        """Seed of the discovery."""

    def samples(self) -> StageSamples:
        """The sets that the discoverer's row says it `reads`, collected on first use; the others are empty.

        A set is the same for every discoverer of equal seed.
        """

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the stage's reward terms that are to be explained: the columns of its graph."""

    def world(self) -> Worlds:
        """One world of the task for queries of your own, of shape (); every step of it counts.

        Raises `UserError` if there are only files.
        """

    def walk(self, rng: np.random.Generator) -> Walk:
        """A random walk through the stage in `world`, from each state of which any action can be tried.

        Its sequences are as long as those of the samples, and actions are held as long. Raises `UserError` if there are
        only files or the world cannot be restored.
        """

    def keep(self, name: str, samples: Samples) -> None:
        """Store samples that were taken from `world` beside the others, and let them enter the graph's data hash."""

    def report(self, share: float, doing: str) -> None:
        """How far this stage is, in [0, 1], beyond collecting `samples`."""


@dataclass(frozen=True)
class Discoverer:
    """A discoverer, as a plugin registers it through `causalbench_discoverers`.

    `discover_stage` returns the graph of one stage; it raises `UndecidedStageError` when the data do not allow one. It
    imports heavy libraries when called, never before. `about` is a line for people. `settings` is a frozen dataclass,
    every field with a default: its fields are the keys of the section `NAME:` in a suite's `discovery:`; bounds are
    `Annotated` metadata of annotated-types. `presets` are records of it by name. `evidence` describes the arrays that
    its graphs carry. `reads` names the sets of Algorithm 1 that its samples have: others cost no environment step.
    `finish`, if any, is given the graphs of all stages and the settings, for what can be decided only of all together.
    `requires` names what the worlds must be able to do: where they cannot, a suite skips the cell.
    `modules` are the optional imports that it needs and `extra` the pip requirement that installs them.
    """

    name: str
    discover_stage: Callable[[StageProblem], StageGraph]
    about: str
    settings: type[Any] = NoSettings
    presets: Mapping[str, Any] = field(default_factory=dict)
    evidence: tuple[EvidenceColumn, ...] = ()
    reads: frozenset[SampleSet] = SAMPLE_SETS
    finish: Callable[[Sequence[StageGraph], DiscoverySettings], Sequence[StageGraph]] | None = None
    requires: frozenset[Capability] = frozenset()
    modules: tuple[str, ...] = ()
    extra: str = ""

    def __post_init__(self) -> None:
        names = [column.name for column in self.evidence]
        taken = sorted({*names} & {*RESERVED}) + sorted({name for name in names if names.count(name) > 1})
        mains = [column.name for column in self.evidence if column.main]
        if taken:
            raise UserError(f"discoverer {self.name!r}: evidence {taken[0]!r}: tables have such a column already")
        if len(mains) > 1 or any(column.main and column.per != "edge" for column in self.evidence):
            raise UserError(f"discoverer {self.name!r}: evidence {mains}: expected one main column at most, per edge")

    @property
    def option_names(self) -> tuple[str, ...]:
        """The names of its own settings."""
        return tuple(f.name for f in fields(self.settings))

    def configure(
        self, preset: str = "quick", shared: Mapping[str, Any] | None = None, own: Mapping[str, Any] | None = None
    ) -> DiscoverySettings:
        """Complete settings: those of `preset`, with some of the `shared` and of its `own` replaced by name.

        A preset is taken from the shared ones and from the discoverer's own; where one of the two has none of that
        name, its defaults stand. Raises `UnknownNameError` for a preset that neither has or a setting of another name.
        """
        if preset not in PRESETS and preset not in self.presets:
            raise UnknownNameError("preset", preset, {*PRESETS, *self.presets})
        for name in own or ():
            if name not in self.option_names:
                raise UnknownNameError(f"setting of discoverer {self.name!r}", name, (*SHARED, *self.option_names))
        options = replace(self.presets.get(preset, self.settings()), **dict(own or {}))
        changed = {"discoverer": self.name, "options": options} | dict(shared or {})
        return replace(PRESETS.get(preset, DiscoverySettings()), **changed)

    def complete(self, settings: DiscoverySettings) -> DiscoverySettings:
        """The settings with its own defaults where they have no `options`. Raises `UserError` for another's record."""
        if settings.options is None:
            return replace(settings, options=self.settings())
        if not isinstance(settings.options, self.settings):
            raise UserError(
                f"discoverer {self.name!r} takes {self.settings.__name__} as options, "
                f"got {type(settings.options).__name__}"
            )
        return settings

    def check(self, found: StageGraph) -> None:
        """Raise `DiscovererError` unless a stage has arrays of the right shape, all described by `evidence`."""
        who, shape = f"discoverer {self.name!r}, stage {found.stage}", (len(found.actions), len(found.terms))
        if found.matrix.shape != shape or found.matrix.dtype != np.bool_:
            raise DiscovererError(f"{who}: matrix: expected bool {shape}, got {_kind(found.matrix)}")
        shapes = {"edge": shape, "term": shape[1:]}
        described = {column.name: shapes.get(column.per) for column in self.evidence}
        for name, values in found.evidence.items():
            if name not in described:
                raise DiscovererError(f"{who}: evidence {name!r} is not described; add an EvidenceColumn of that name")
            if described[name] not in (None, values.shape):
                raise DiscovererError(f"{who}: evidence {name!r}: expected {described[name]}, got {_kind(values)}")
            if not np.isfinite(values).all():
                raise DiscovererError(f"{who}: evidence {name!r} is not finite; say 0 where nothing is known")


def _kind(values: NDArray[Any]) -> str:
    return f"{values.dtype} {values.shape}"


RANDOM: frozenset[SampleSet] = frozenset(("random",))
OBSERVED: frozenset[SampleSet] = frozenset(("random", "inference"))
NO_SAMPLES: frozenset[SampleSet] = frozenset()
