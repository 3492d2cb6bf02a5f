"""Counts of what happened during training: transitions between stages, reversals, episodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.records import TrainingCounts
from causalbench.core.networks.state import State

LONG = 3  # steps that a reversal lasts to count as long


class Counter:
    """Counts steps, moves between stages, reversals and episodes of training, from `infos` of `StageTaskVectorEnv`."""

    def __init__(self, n_stages: int, n_envs: int) -> None:
        self.counts = TrainingCounts(
            transitions=np.zeros((n_stages + 1, n_stages + 1), dtype=np.int64),
            reached=dict.fromkeys(range(1, n_stages + 1), 0),
        )
        self._best = np.zeros(n_envs, dtype=np.int64)  # highest stage of the episode so far
        self._lost = np.zeros(n_envs, dtype=np.int64)  # stage from which the running reversal fell; 0: none
        self._lost_for = np.zeros(n_envs, dtype=np.int64)  # steps since

    def add(self, infos: dict[str, Any], over: NDArray[np.bool_]) -> None:
        """Count one step of every world; `over` (n,) says whose episode ended with it."""
        counts, stage, next_stage = self.counts, infos["stage"], infos["next_stage"]
        counts.env_steps += len(over)
        np.add.at(counts.transitions, (stage, next_stage), 1)
        counts.reversals += int(infos["reversal"].sum())
        counts.successes += int(infos["is_success"].sum())
        counts.episodes += int(over.sum())

        falls = infos["reversal"] & (self._lost == 0)
        self._lost[falls], self._lost_for[falls] = stage[falls], 0
        regained = next_stage >= self._lost
        self._lost[regained] = 0
        self._lost_for[self._lost > 0] += 1
        counts.long_reversals += int(((self._lost > 0) & (self._lost_for == LONG)).sum())

        reached = np.maximum(stage, next_stage)
        for world in np.flatnonzero(reached > self._best):
            for s in range(self._best[world] + 1, reached[world] + 1):
                counts.reached[int(s)] += 1
        self._best = np.where(over, 0, np.maximum(self._best, reached))
        self._lost = np.where(over, 0, self._lost)

    def state(self) -> State:
        """The counts and the episodes under way."""
        counts = vars(self.counts) | {name: _texts(getattr(self.counts, name)) for name in ("reached", "updates")}
        return counts | {"best": self._best, "lost": self._lost, "lost_for": self._lost_for}

    def load_state(self, state: State) -> None:
        """Go on from `state`."""
        state = dict(state)
        self._best, self._lost, self._lost_for = (np.array(state.pop(k)) for k in ("best", "lost", "lost_for"))
        per_stage = {name: {int(s): n for s, n in state[name].items()} for name in ("reached", "updates")}
        self.counts = TrainingCounts(**state | per_stage | {"transitions": np.array(state["transitions"])})


def _texts(per_stage: Mapping[int, int]) -> dict[str, int]:
    """JSON's keys are texts."""
    return {str(stage): n for stage, n in per_stage.items()}
