"""A planted world for whoever has a method: its samples, its truth, and how right an answer is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.planted.forms import FORMS
from causalbench.core.discovery.planted.spec import PlantedWorld
from causalbench.core.discovery.planted.worlds import PlantedWorlds
from causalbench.core.discovery.truth.score import Score

Array = NDArray[np.float64]

SEQUENCE_LENGTH = 10  # as in discovery, so that both speak of the same states
MONTE_CARLO_WORLDS = 8_000


class PlantedSamples(NamedTuple):
    """Random transitions of one stage of a planted world; row i of all arrays is one step."""

    states: Array  # (n, n_state), before the step
    actions: Array  # (n, n_actions), independent and uniform in [-1, 1]
    rewards: Array  # (n, n_terms)
    sequence: NDArray[np.int64]  # (n,) number of the uninterrupted sequence of steps


def samples(world: PlantedWorld, n: int, stage: int = 1, seed: int = 0) -> PlantedSamples:
    """Return `n` steps of random actions in `stage`, from 1, in sequences of at most ten steps that never leave it."""
    rng = np.random.default_rng([seed, stage])
    count = -(-n // SEQUENCE_LENGTH)
    worlds = PlantedWorlds(world, (count,))
    rows = []
    _enter(worlds, np.ones(count, dtype=bool), rng, stage)
    sequence, following = np.arange(count), count
    for _ in range(SEQUENCE_LENGTH):
        states, actions = worlds.states().astype(np.float64), rng.uniform(-1.0, 1.0, (count, world.n_actions))
        step = worlds.step(actions)
        rows.append((states, actions, step.rewards, sequence.copy()))
        left = (step.next_stage != stage) | step.terminated
        sequence[left] = following + np.arange(left.sum())
        following += int(left.sum())
        _enter(worlds, left, rng, stage)
    return PlantedSamples(*(np.concatenate(column)[:n] for column in zip(*rows, strict=True)))


def effects(world: PlantedWorld, stage: int, action_repeat: int = 1) -> Array:
    """Return the effects (n_actions, n_terms), T = E[(r(s, a) - r(s, a with a_k = 0))^2] / Var(r).

    Actions are held for `action_repeat` steps.

    In closed form where there is one: one step and plain terms. Else from 80,000 states; 0 for a term that never
    varies. The noise is the same in both; what restoring draws anew counts in the variance alone.
    """
    closed = _closed_form(world, stage)
    if action_repeat == 1 and all(term.shape == "plain" for term in world.stages[stage - 1]):
        return closed
    return _monte_carlo(world, stage, action_repeat)


def _closed_form(world: PlantedWorld, stage: int) -> Array:
    found = np.zeros((world.n_actions, world.n_terms))
    for j, term in enumerate(world.stages[stage - 1]):
        for part in term.parts:
            if not part.lag and j not in world.constant:
                found[list(part.actions), j] += part.share * FORMS[part.form].ratio * (1 - world.restore_noise)
    return found


def _monte_carlo(world: PlantedWorld, stage: int, action_repeat: int, n: int = MONTE_CARLO_WORLDS) -> Array:
    rng = np.random.default_rng(0)
    worlds = PlantedWorlds(world, (n,))
    squares, rewards = np.zeros((world.n_actions, world.n_terms)), []
    _enter(worlds, np.ones(n, dtype=bool), rng, stage)
    for _ in range(SEQUENCE_LENGTH):
        actions = rng.uniform(-1.0, 1.0, (n, world.n_actions))
        start = worlds.saved()
        others = []
        for k in range(world.n_actions):
            tried = actions.copy()
            tried[:, k] = 0.0
            others.append(worlds.step(tried, action_repeat).rewards)
            worlds.load(start)
        step = worlds.step(actions, action_repeat)
        rewards.append(step.rewards)
        squares += np.mean((np.array(others) - step.rewards) ** 2, axis=1)
        _enter(worlds, (step.next_stage != stage) | step.terminated, rng, stage)
    variance = np.concatenate(rewards).var(0)
    return np.divide(squares / SEQUENCE_LENGTH, variance, out=np.zeros_like(squares), where=variance > 0)


def _enter(worlds: PlantedWorlds, which: NDArray[np.bool_], rng: np.random.Generator, stage: int) -> None:
    index = np.flatnonzero(which).tolist()
    worlds.reset(index, [rng] * len(index), stage)


def score(world: PlantedWorld, matrices: Sequence[NDArray[np.bool_]]) -> Score:
    """Compare `matrices` (n_actions, n_terms), one per stage, with the actions that the formulas read."""
    total = Score(0, 0, 0)
    for stage, matrix in enumerate(matrices, start=1):
        truth, found = world.causes(stage), np.asarray(matrix, dtype=bool)
        total += Score(int((truth & found).sum()), int((found & ~truth).sum()), int((truth & ~found).sum()))
    return total


class Ranking(NamedTuple):
    """How well numbers order edges, whatever the threshold; NaN where all edges are there or none is."""

    auroc: float  # chance that an edge that is there has the larger number; ties count half
    average_precision: float


def ranking(causes: NDArray[np.bool_], numbers: Array) -> Ranking:
    """Judge how well `numbers`, larger for surer edges, find the edges of `causes`, both of one shape."""
    truth, values = np.ravel(causes), np.ravel(numbers)
    if truth.all() or not truth.any():
        return Ranking(float("nan"), float("nan"))
    above = values[truth][:, None] - values[~truth]
    thresholds = np.unique(values)[::-1]
    hits = np.array([(values[truth] >= x).sum() for x in thresholds])
    taken = np.array([(values >= x).sum() for x in thresholds])
    gained = np.diff(hits, prepend=0) / truth.sum()
    return Ranking(float(((above > 0) + 0.5 * (above == 0)).mean()), float((gained * hits / taken).sum()))
