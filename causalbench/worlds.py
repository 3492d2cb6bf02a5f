"""Worlds with a known causal graph, on which a method of causal discovery is tested: docs/how-to/planted_worlds.md."""

from __future__ import annotations

from functools import partial

from causalbench.core.discovery import pipeline
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.planted.examine import PlantedSamples, Ranking, effects, ranking, samples, score
from causalbench.core.discovery.planted.kinds import KINDS, catalogue, planted
from causalbench.core.discovery.planted.spec import VERSION, Part, PlantedTerm, PlantedWorld
from causalbench.core.discovery.planted.worlds import PlantedWorlds, make_planted_worlds
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.plugins.manager import installed

__all__ = [
    "KINDS",
    "Part",
    "PlantedSamples",
    "PlantedTerm",
    "PlantedWorld",
    "PlantedWorlds",
    "Ranking",
    "VERSION",
    "catalogue",
    "discover",
    "effects",
    "make_planted_worlds",
    "planted",
    "ranking",
    "samples",
    "score",
]


def discover(world: PlantedWorld, settings: DiscoverySettings, seed: int = 0) -> CausalGraph:
    """Return the causal graph that the registered discoverer `settings.discoverer` finds in `world`.

    Raises `UnknownNameError` for a discoverer that is not installed.
    """
    make = partial(make_planted_worlds, world)
    known = installed().discoverers
    return pipeline.discover(world.task, make, settings, seed, lambda share, doing: None, discoverers=known)
