"""Graded ground truth: from a snapshot, the same state and the same other actions, a_k random against 0.

The effect of action k on term j is T_kj = E[(r_j(s, a) - r_j(s, a with a_k = 0))^2] / Var(r_j(s, a)) over states that
random sequences visit. It needs no model, only a scene that restores snapshots. Limits are fixed here, before any
discovery is looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import CausalGraph, StageGraph, declared_matrix
from causalbench.core.env import StageTaskEnv
from causalbench.core.scene import Scene
from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task

ABSENT_BELOW = 0.005  # upper bound of the interval
STRONG_ABOVE = 0.05  # lower bound of the interval
RESAMPLES = 2000
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

    `floor` is 0 where restoring is exact.
    """

    stage: int
    actions: tuple[str, ...]
    terms: tuple[str, ...]
    effect: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    floor: NDArray[np.float64]

    def grades(self) -> list[list[Grade]]:
        """[action][term] grades."""
        return [
            [_grade(self.effect[k, j], self.low[k, j], self.high[k, j]) for j in range(len(self.terms))]
            for k in range(len(self.actions))
        ]


def _grade(effect: float, low: float, high: float) -> Grade:
    if np.isnan(effect):
        return Grade.untestable
    if high < ABSENT_BELOW:
        return Grade.absent
    return Grade.strong if low > STRONG_ABOVE else Grade.weak


def consult_oracle(
    task: Task, make_scene: Callable[[], Scene], states: int, seed: int, on_progress: Callable[[float, str], None]
) -> tuple[StageTruth, ...]:
    """The truth of every stage from `states` visited states each; takes (n_actions + 2) control steps per state."""
    scene = make_scene()
    try:
        env = StageTaskEnv(task, scene)
        return tuple(_stage_truth(env, stage, states, seed, on_progress) for stage in range(1, task.n_stages + 1))
    finally:
        scene.close()


def oracle_graph(task: Task, truth: tuple[StageTruth, ...], seed: int) -> CausalGraph:
    """The strong edges as a graph, what a perfect discovery would find; `env_steps` is what asking took."""
    stages = []
    for stage in truth:
        strong = np.array(stage.grades()) == Grade.strong
        untestable = np.isnan(stage.effect).any(0)
        matrix = np.where(untestable, declared_matrix(task, stage.stage, stage.terms), strong)
        stages.append(StageGraph(stage.stage, task.actions, stage.terms, matrix))
    env_steps = ORACLE_STATES * (len(task.actions) + 2) * task.n_stages
    provenance = {"seed": seed, "states": ORACLE_STATES, "strong_above": STRONG_ABOVE}
    return CausalGraph(task.name, task.version, "oracle", tuple(stages), env_steps, provenance)


def _stage_truth(
    env: StageTaskEnv, stage: int, states: int, seed: int, on_progress: Callable[[float, str], None]
) -> StageTruth:
    task, scene = env.task, env.scene
    terms = task.stage_terms(stage, discoverable_only=True)
    columns = [task.term_names.index(name) for name in terms]
    indices = np.array([scene.spec.actions.index(a) for a in task.actions])
    rng = np.random.default_rng([seed, stage])
    inside = np.array(stage)
    k = len(task.actions)
    # Row 0 is the action itself, row 1 the same once more, row 2 + i the action with a_i = 0.
    rewards = np.empty((states, k + 2, len(terms)))
    sequence = np.zeros(states, dtype=np.int64)
    full = np.zeros(len(scene.spec.actions))
    length = SEQUENCE_LENGTH
    for n in range(states):
        if length == SEQUENCE_LENGTH:
            env.reset(seed=int(rng.integers(2**31)), options={"stage": stage})
            length = 0
        sequence[n] = sequence[n - 1] + (length == 0)
        start, before = scene.snapshot(), scene.facts()
        action = rng.uniform(-1.0, 1.0, k)
        tried = np.tile(action, (k + 2, 1))
        tried[np.arange(2, k + 2), np.arange(k)] = 0.0
        for row in range(k + 1, -1, -1):  # the action itself last, so that the sequence goes on from it
            scene.restore(start)
            full[indices] = tried[row]
            scene.step(full)
            result = judge(task, inside, before, tried[row], scene.facts())
            rewards[n, row] = result.vector_reward[columns]
        length = SEQUENCE_LENGTH if result.next_stage != stage or result.success else length + 1
        on_progress((stage - 1 + (n + 1) / states) / task.n_stages, f"stage {stage}: oracle")
    effect, low, high = _effects(rewards, sequence, rng)
    return StageTruth(stage, task.actions, terms, effect[1:], low[1:], high[1:], effect[0])


def _effects(
    rewards: NDArray[np.float64], sequence: NDArray[np.int64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Effects of rows 1 and up against row 0, with bootstrap bounds; each (n_rows - 1, n_terms).

    Whole sequences are resampled, since states of one sequence resemble each other.
    """
    squares = (rewards[:, 1:] - rewards[:, :1]) ** 2
    taken = rewards[:, 0]
    _, group = np.unique(sequence, return_inverse=True)
    n_groups = int(group.max()) + 1

    def total(values: NDArray[Any]) -> NDArray[np.float64]:
        out = np.zeros((n_groups, *values.shape[1:]))
        np.add.at(out, group, values)
        return out

    count, first, second, square = (
        total(x) for x in (np.ones(len(taken)), taken, taken**2, squares.reshape(len(squares), -1))
    )

    def ratio(weights: NDArray[np.float64]) -> NDArray[np.float64]:
        n = weights @ count
        variance = weights @ second / n[:, None] - (weights @ first / n[:, None]) ** 2
        mean_square = (weights @ square / n[:, None]).reshape(len(weights), *squares.shape[1:])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(variance[:, None] > 1e-12, mean_square / variance[:, None], np.nan)

    effect = ratio(np.ones((1, n_groups)))[0]
    weights = rng.multinomial(n_groups, np.full(n_groups, 1 / n_groups), size=RESAMPLES).astype(np.float64)
    resampled = ratio(weights)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.full_like(effect, np.nan), np.full_like(effect, np.nan)
    testable = ~np.isnan(effect)
    # A resample in which a rare reward never varies says nothing about its effect.
    if testable.any():
        low[testable], high[testable] = np.nanquantile(resampled[:, testable], [tail, 1 - tail], axis=0)
    return effect, low, high
