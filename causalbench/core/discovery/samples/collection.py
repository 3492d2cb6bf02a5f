"""The samples of all stages, collected when asked for, in this process or several, and kept if there is a store."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from causalbench.core.discovery.samples.pool import SamplePool, pays
from causalbench.core.discovery.samples.streams import Collector, Recipe, Stream
from causalbench.core.discovery.samples.transitions import Samples, StageSamples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.errors import LayoutDrawError, UndecidedStageError, UserError

LEAST_SHARE = 0.5
"""A stage in which some set has less than this share of the samples that were asked for is not decided."""


class Collection:
    """The samples of all stages, each collected when first asked for; with several `cores` all stages at once.

    `on_share(stage, share)` is told how far a stage is; `env_steps` counts those of the stages that were asked for.
    A small collection, or a task or a factory of worlds that cannot be pickled, is stepped in this process alone.
    """

    def __init__(self, recipe: Recipe, cores: int, on_share: Callable[[int, float], None]) -> None:
        self.recipe, self.on_share = recipe, on_share
        self.env_steps: dict[int, int] = {}
        self._collector = Collector(recipe)
        self._cores = cores if pays(recipe, cores) else 1
        self._pool: SamplePool | None = None  # started when samples are first asked for: some methods may not ask

    def stage(self, stage: int) -> StageSamples:
        """The samples of one stage. Raises `LayoutDrawError` or `UndecidedStageError`."""
        wanted = self.recipe.streams(stage)
        if not wanted:
            raise UserError(
                f"discoverer {self.recipe.settings.discoverer!r} asks for samples but registered `reads` as empty; "
                "name there the sets that it needs"
            )
        planned = sum(stream.count for stream in wanted) * self.recipe.settings.action_repeat

        def on_steps(steps: int) -> None:
            self.env_steps[stage] = steps
            self.on_share(stage, min(1.0, steps / planned))

        if self._pool is None and self._cores > 1:
            self._pool = SamplePool(self.recipe, self._cores)
        found = self._pool.gather(stage, on_steps) if self._pool else self._gather(wanted, on_steps)
        return _assemble(self.recipe.settings, wanted, found)

    def close(self) -> None:
        """Stop collecting and release the worlds."""
        if self._pool:
            self._pool.close()
        self._collector.close()

    def _gather(self, wanted: list[Stream], on_steps: Callable[[int], None]) -> list[Samples]:
        steps, found, errors = 0, list[Samples](), list[LayoutDrawError]()

        def on_step(n: int) -> None:
            nonlocal steps
            steps += n
            on_steps(steps)

        for stream in wanted:
            try:
                found.append(self._collector(stream, on_step))
            except LayoutDrawError as error:  # the rest is collected, as it would be by several processes
                errors.append(error)
        if errors:
            raise errors[0]
        return found


def _assemble(settings: DiscoverySettings, wanted: list[Stream], found: list[Samples]) -> StageSamples:
    """The sets of one stage by their names, interventions and placebos cut to one length.

    Raises `UndecidedStageError` where too much of a set is missing.
    """
    named = {stream.name: samples for stream, samples in zip(wanted, found, strict=True)}
    notes = _shortfalls(wanted, found)
    empty = found[0].first(0)
    random, inference = named.pop("random", empty), named.pop("inference", empty)
    shortest = min(map(len, named.values()), default=0)
    extra, *interventions = [named.pop("placebo", None), *named.values()]
    if settings.sequence_length > 1 and 0 < len(random) == len(np.unique(random.sequence)):
        notes.append("every random step left the stage, so that each sample is a first step")
    return StageSamples(
        random,
        inference,
        tuple(samples.first(shortest) for samples in interventions),
        extra and extra.first(shortest),
        tuple(notes),
    )


def _shortfalls(wanted: list[Stream], found: list[Samples]) -> list[str]:
    """A sentence for every set that has fewer samples than were asked for."""
    notes = []
    for stream, samples in zip(wanted, found, strict=True):
        if len(samples) < stream.count:
            notes.append(
                f"{len(samples)} of {stream.count} samples in {stream.name!r}: "
                f"{samples.refused} of {samples.env_steps} steps were not finite"
            )
            if len(samples) < max(2, LEAST_SHARE * stream.count):
                raise UndecidedStageError(notes[-1])
    return notes
