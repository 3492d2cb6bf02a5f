"""Settings of a discovery that every discoverer shares; what belongs to one of them stands in its own record."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt

from causalbench.core.discovery.graph import UndecidedAs


@dataclass(frozen=True)
class NoSettings:
    """The record of a discoverer that has no settings of its own."""


@dataclass(frozen=True)
class DiscoverySettings:
    """Which discoverer finds the graph, and from which data. The presets `paper` and `paper_large` are the paper's.

    `options` is the record of the discoverer's own settings; None stands for its defaults.
    """

    discoverer: str = "kl"  # name of a registered discoverer; "kl" is the paper's
    training_count: Annotated[int, Gt(0)] = 3_000  # samples in D_random and in each D_do[a_k], per stage
    inference_fraction: Annotated[float, Gt(0)] = 0.2  # size of D_inference relative to training_count
    sequence_length: Annotated[int, Gt(0)] = 10  # actions until the stage is entered again
    action_repeat: Annotated[int, Gt(0)] = 1  # control steps for which an action is held; each one counts
    # What reward models see beside the state: "sectors" of the LiDAR; "paper": image or LiDAR, through convolutions.
    observation: Literal["state", "sectors", "paper"] = "state"
    features: bool = True  # whether reward models see the task's features beside the state
    n_placebos: Annotated[int, Ge(0)] = 8  # action dimensions that no world reads, tested like actions
    # In D_do[a_k], a_k is 0 in a random half of the steps or, as in the paper, in all steps of a sequence.
    intervene: Literal["step", "sequence"] = "step"
    undecided: UndecidedAs = "present"  # what an undecided edge is for a learner
    oracle_states: Annotated[int, Ge(0)] = 0  # states per stage with which an oracle grades the graph; 0: none
    options: Any = None  # the discoverer's own record; None: its defaults


SHARED = tuple(field.name for field in fields(DiscoverySettings) if field.name not in ("discoverer", "options"))
"""The names of the settings that any discoverer has."""

PAPER = DiscoverySettings(features=False, n_placebos=0, intervene="sequence")
PRESETS = {
    "quick": DiscoverySettings(),
    "paper": replace(PAPER, training_count=5_000),  # pure manipulation
    "paper_large": replace(PAPER, training_count=10_000),  # mobile manipulation
}
"""Named starting points; a discoverer may have presets of the same names for its own record. The paper's data sizes."""
