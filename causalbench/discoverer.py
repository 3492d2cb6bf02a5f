"""An author of a discoverer imports this module alone. `examples/a_discoverer` is a worked example."""

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.registry import SAMPLE_SETS, Discoverer, SampleSet, StageProblem
from causalbench.core.discovery.samples.transitions import Samples, StageSamples, varies
from causalbench.core.discovery.settings import DiscoverySettings, NoSettings
from causalbench.core.world.capabilities import Capability
from causalbench.errors import UndecidedStageError, UserError
from causalbench.plugins.hookspecs import hookimpl

__all__ = [
    "SAMPLE_SETS",
    "Capability",
    "Discoverer",
    "DiscoverySettings",
    "EvidenceColumn",
    "NoSettings",
    "SampleSet",
    "Samples",
    "StageGraph",
    "StageProblem",
    "StageSamples",
    "UndecidedStageError",
    "UserError",
    "hookimpl",
    "varies",
]
