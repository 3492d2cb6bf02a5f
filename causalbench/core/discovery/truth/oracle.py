"""Graded ground truth: from a snapshot, the same state and the same other actions, a_k random against 0.

The effect of action k on term j is T_kj = E[(r_j(s, a) - r_j(s, a with a_k = 0))^2] / Var(r_j(s, a)) over states that
random sequences visit. It needs no model, only a world that can be restored. Where restoring is inexact, two
independent repetitions give E[(difference)(difference of the other)], which errors of restoring do not bias. Limits are
fixed here, before any discovery is looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import CausalGraph, StageGraph, declared_matrix
from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.discovery.truth.effects import ABSENT_BELOW, RULE_OF_THREE, STRONG_ABOVE, effects
from causalbench.core.staged.worlds import MakeWorlds, Worlds
from causalbench.core.tasks.stage_task import StageTask

ORACLE_STATES = 400  # visited states per stage
CONFIDENCE = 0.95
SEQUENCE_LENGTH = 10  # as in discovery, so that both speak of the same states


class Grade(StrEnum):
    """How much an action matters to a term; untestable where the term never varies."""

    absent = "absent"
    weak = "weak"
    strong = "strong"
    untestable = "untestable"


@dataclass(frozen=True)
class StageTruth:
    """Effects of one stage, arrays (n_actions, n_terms); `floor` (n_terms,) is what repeating the same action shows.

    Where no visited state showed an effect, `high` is what such a sample allows with 95% confidence, three in as many
    states. `floor` is 0 where restoring is exact, which the world declares or not (`exact_restore`). All is about
    actions held for `action_repeat` control steps, in `states` visited states; `env_steps` is what asking took.
    """

    stage: int
    actions: tuple[str, ...]
    terms: tuple[str, ...]
    effect: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    floor: NDArray[np.float64]
    exact_restore: bool
    states: int
    env_steps: int
    action_repeat: int = 1

    def grades(self) -> list[list[Grade]]:
        """[action][term] grades."""
        return [
            [_grade(self.effect[k, j], self.low[k, j], self.high[k, j]) for j in range(len(self.terms))]
            for k in range(len(self.actions))
        ]


def _grade(effect: float, low: float, high: float) -> Grade:
    if np.isnan(effect):
        return Grade.untestable
    if high < ABSENT_BELOW or effect == 0.0:  # no state showed any effect, however small
        return Grade.absent
    return Grade.strong if low > STRONG_ABOVE else Grade.weak


def consult_oracle(
    task: StageTask,
    make_worlds: MakeWorlds,
    states: int,
    seed: int,
    on_progress: Callable[[float, str], None],
    action_repeat: int = 1,
) -> tuple[StageTruth, ...]:
    """The truth of every stage about actions held for `action_repeat` steps, from `states` visited states each.

    Raises `UserError` where worlds cannot be restored.
    """
    with closing(make_worlds()) as worlds:
        return tuple(
            _stage_truth(worlds, stage, states, seed, on_progress, action_repeat)
            for stage in range(1, task.n_stages + 1)
        )


def oracle_graph(task: StageTask, truth: tuple[StageTruth, ...], seed: int) -> CausalGraph:
    """The strong edges as a graph, what a perfect discovery would find; `env_steps` is what asking took."""
    stages = []
    for stage in truth:
        strong = np.array(stage.grades()) == Grade.strong
        untestable = np.isnan(stage.effect).any(0)
        matrix = np.where(untestable, declared_matrix(task, stage.stage, stage.terms), strong)
        stages.append(StageGraph(stage.stage, task.actions, stage.terms, matrix))
    asked = {"states": truth[0].states, "action_repeat": truth[0].action_repeat}
    provenance = {"seed": seed, "strong_above": STRONG_ABOVE} | asked
    env_steps = sum(stage.env_steps for stage in truth)
    return CausalGraph(task.name, task.version, "oracle", tuple(stages), env_steps, provenance)


def _compared(walk: Walk) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rewards (n_terms,) in the next state; squared differences (n_actions + 1, n_terms), the repetition's first."""
    if walk.exact:
        rewards = walk.compare()
        return rewards[0], np.square(rewards[1:] - rewards[0])
    one, other = walk.compare_twice()
    products = (one[1:] - one[0]) * (other[1:] - other[0])
    return one[0], np.vstack([np.square(other[:1] - one[:1]), products])


def _stage_truth(
    worlds: Worlds,
    stage: int,
    states: int,
    seed: int,
    on_progress: Callable[[float, str], None],
    action_repeat: int,
) -> StageTruth:
    task, before = worlds.task, worlds.env_steps
    terms = task.stage_terms(stage, discoverable_only=True)
    rng = np.random.default_rng([seed, stage])
    walk = Walk(worlds, stage, rng, SEQUENCE_LENGTH, action_repeat)
    k = len(task.actions)
    taken, squares = np.empty((states, len(terms))), np.empty((states, k + 1, len(terms)))
    sequence = np.zeros(states, dtype=np.int64)
    for n in range(states):
        taken[n], squares[n] = _compared(walk)
        sequence[n] = walk.sequence
        on_progress((stage - 1 + (n + 1) / states) / task.n_stages, f"stage {stage}: oracle")
    effect, low, high = effects(taken, squares, sequence, rng, CONFIDENCE)
    high = np.where(effect == 0.0, RULE_OF_THREE / states, high)
    return StageTruth(
        stage, task.actions, terms, effect[1:], low[1:], high[1:], effect[0], walk.exact, states,
        worlds.env_steps - before, action_repeat,
    )  # fmt: skip
