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
    """Which discoverer, on how much data of what kind. The defaults are ours, `PRESETS["paper"]` the paper's.

    `options` is the record that the discoverer registered as its `settings`; None stands for that record's defaults.
    """

    discoverer: str = "kl"  # name of a registered method; "kl" is the paper's
    training_count: Annotated[int, Gt(0)] = 3_000  # samples in D_random and in each D_do[a_k], per stage
    inference_fraction: Annotated[float, Gt(0)] = 0.2  # size of D_inference relative to training_count
    sequence_length: Annotated[int, Gt(0)] = 10  # actions until the stage is entered anew; no function of sample count
    action_repeat: Annotated[int, Gt(0)] = 1  # control steps for which an action is held; each one counts
    # What reward models see, too: "sectors" of the LiDAR, "paper": the image or the LiDAR through convolutions.
    observation: Literal["state", "sectors", "paper"] = "state"
    features: bool = True  # reward models see the task's features, too, see `StageTask.features`
    n_placebos: Annotated[int, Ge(0)] = 8  # action dimensions that no world sees, probed like actions; 0: literal
    # Whether D_do[a_k] has a_k = 0 in a random half of its steps, or, as the paper's, throughout each sequence.
    intervene: Literal["step", "sequence"] = "step"
    undecided: UndecidedAs = "present"  # what a learner takes an edge for that discovery could not decide
    oracle_states: Annotated[int, Ge(0)] = 0  # visited states per stage by which an oracle grades the graph; 0: none
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
