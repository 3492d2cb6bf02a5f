"""What a training run reports, as plain numbers: no torch, no simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Episode:
    """One episode of an evaluation, from stage 1. `episode` counts from 0 in each mode; the start is the same in both.

    `stages` has U(s) before each step, from 1, and `final_stage` that after the last one, n_stages + 1 on success.
    `held` says whether a success stood what the task puts it to; None without success or test. `returns` has the
    undiscounted return of each reward term.
    """

    episode: int
    deterministic: bool
    success: bool
    held: bool | None
    n_stages: int
    stages: tuple[int, ...]
    final_stage: int
    returns: Mapping[str, float]

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Episode:
        """The episode of which `record` is what `dataclasses.asdict` made, also after a way through JSON."""
        return cls(**{**record, "stages": tuple(record["stages"])})

    @property
    def length(self) -> int:
        """Steps."""
        return len(self.stages)

    @property
    def reversals(self) -> int:
        """Steps that led to an earlier stage."""
        return sum(after < before for before, after in pairwise((*self.stages, self.final_stage)))


@dataclass(frozen=True)
class Evaluation:
    """The outcome of an evaluation of a policy on full task episodes from stage 1.

    Success is a share in [0, 1]; `reversals_per_episode`, `mean_final_stage` (success counts as n_stages + 1) and
    `term_returns` (mean undiscounted return of each reward term per episode) are of the deterministic episodes.
    `success_sampled` is that of the training episodes which ended since the evaluation before, None if none did; in the
    last evaluation of a training run it is that of `episodes` more episodes with actions drawn from the policy.
    `held_rate` is the share of all successes played here that stood what the task puts a success to
    (`Task.after_success`: pure manipulation lifts the box and holds it for 2 s); None if there were none. `played`
    are the episodes themselves; those of the last evaluation of a training run are kept, all others are forgotten.
    """

    env_steps: int
    episodes: int
    success_deterministic: float
    success_sampled: float | None
    held_rate: float | None
    reversals_per_episode: float
    mean_final_stage: float
    mean_length: float
    term_returns: Mapping[str, float]
    played: tuple[Episode, ...] = ()

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Evaluation:
        """The evaluation of which `record` is what `dataclasses.asdict` made, also after a way through JSON."""
        return cls(**{**record, "played": tuple(map(Episode.from_record, record["played"]))})


@dataclass
class TrainingCounts:
    """Counts of a training. `transitions[i, j]` is the number of steps from stage i to j; row and column 0 are unused.

    `long_reversals` are those that last at least 3 steps, because a state at the edge of a tolerance can change its
    stage in every step.
    """

    transitions: NDArray[np.int64]
    env_steps: int = 0
    episodes: int = 0
    successes: int = 0
    reversals: int = 0
    long_reversals: int = 0
    reached: dict[int, int] = field(default_factory=dict)  # stage -> episodes that reached it
    updates: dict[int, int] = field(default_factory=dict)  # stage -> gradient updates


@dataclass(frozen=True)
class ReversalCauses:
    """The reversals of one episode from one stage; `causes_graph` is the hash of the graph whose causes are meant.

    `reversals_repeated` came again when the unchanged step was taken again, which is a check of the snapshots.
    `vanished_without_redundant` did not come with every action outside the stage's causes at 0, and
    `vanished_without_causes` did not come with every cause at 0.
    """

    episode: int
    deterministic: bool
    stage: int
    steps_in_stage: int
    reversals: int
    reversals_repeated: int
    vanished_without_redundant: int
    vanished_without_causes: int
    causes_graph: str = ""


@dataclass(frozen=True)
class Transfer:
    """How a policy does in the worlds of `played_on`, another backend than the one that it was trained on.

    The numbers are those of an `Evaluation`.
    """

    played_on: str
    episodes: int
    success_deterministic: float
    success_sampled: float
    reversals_per_episode: float
    mean_final_stage: float
