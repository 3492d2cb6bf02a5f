"""Discovery from paired interventions: same state and other actions, a_k random against 0, until an edge is decided.

It estimates the effect that the oracle defines, T_kj = E[(r_j(s, a) - r_j(s, a with a_k = 0))^2] / Var(r_j), from few
states, and stops measuring an edge once its interval leaves no doubt on which side of the grades it lies:

- present: the lower bound exceeds the limit of an absent edge;
- absent: the upper bound, with room for what was not seen, is below the limit of a strong one;
- neither when the budget of the stage is spent: undecided.

Where restoring is inexact every action is tried twice, each time after a restoring of its own, and the product of both
differences stands for the square: its mean is the effect whatever the errors of restoring are.

Actions that showed no effect lately are set to 0 together: where even that changes no reward, none of them did. It
assumes that effects of two actions do not cancel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Gt
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.methods.trials import Trials
from causalbench.core.discovery.registry import NO_SAMPLES, Discoverer, StageProblem
from causalbench.core.discovery.samples.transitions import varies
from causalbench.core.discovery.truth.effects import ABSENT_BELOW, STRONG_ABOVE, effects
from causalbench.core.world.capabilities import Capability
from causalbench.errors import UndecidedStageError

if TYPE_CHECKING:
    from causalbench.core.discovery.truth.counterfactual import Walk

Array = NDArray[np.float64]

CONFIDENCE = 0.99  # of an interval at one look; looks are not corrected for
UNSEEN = math.log(1 / 0.05)  # what n states did not show happens in less than UNSEEN / n of them, with 95% confidence
FIRST_LOOK, NEXT_LOOK = 10, 1.15  # sequences before the first look, and their growth from look to look
ALONE_FROM = 1 / 3  # an action that had an effect in at least this share of states is not tried in a group
STREAM = 100  # beside the numbers of the sets of samples, so that no generator is used twice


@dataclass(frozen=True)
class PairedSettings:
    """Own settings of `paired` and `sufficient`."""

    max_actions: Annotated[int, Gt(0)] = 1_250  # most that are tried in one stage, each held for `action_repeat` steps


def discover_stage(problem: StageProblem) -> StageGraph:
    """Decide the edges of one stage, with at most `max_actions` actions."""
    return measure(problem)[0]


def measure(problem: StageProblem) -> tuple[StageGraph, Walk]:
    """The graph of one stage, and the random walk that visited its states."""
    rng = np.random.default_rng([problem.seed, problem.stage, STREAM])
    walk, repeat = problem.walk(rng), problem.settings.action_repeat
    edges, budget = _Edges(walk), problem.options.max_actions * repeat
    n_actions = len(problem.task.actions)
    next_look, most = FIRST_LOOK, (n_actions + 3 if walk.exact else 2 * n_actions + 2) * repeat  # that one state takes
    while edges.open.any() and edges.trials.env_steps + most <= budget:
        edges.measure()
        if edges.walk.sequence >= next_look:
            edges.look(rng)
            next_look = math.ceil(edges.walk.sequence * NEXT_LOOK)
        problem.report(edges.trials.env_steps / budget, f"{int(edges.open.sum())} edges undecided")
    if edges.refused > len(edges.taken):
        raise UndecidedStageError(f"{edges.refused} of {edges.refused + len(edges.taken)} states were not finite")
    edges.look(rng)
    problem.keep("pairs", edges.trials.samples(edges.refused))
    return edges.graph(), walk


class _Edges:
    """All (action, term) edges of one stage: what was measured of them, and what was decided."""

    def __init__(self, walk: Walk) -> None:
        self.walk, self.exact, self.trials = walk, walk.exact, Trials(walk)
        shape = (len(walk.task.actions), len(walk.terms))
        self.open = np.ones(shape, dtype=bool)
        self.effect, self.low, self.high, self.pairs = (np.zeros(shape) for _ in range(4))
        self.moved = np.zeros(shape)  # states in which an action had an effect
        self.taken: list[Array] = []  # (n_terms,) rewards of the drawn actions
        self.squares: list[Array] = []  # (n_actions, n_terms), 0 for an action without open edges: it is not measured
        self.sequence: list[int] = []
        self.refused = 0

    def measure(self) -> None:
        """One more state: the drawn action, and it with each action that has open edges at 0, alone or in a group."""
        drawn = self.walk.visit()
        taken = self.trials.reward_without(drawn, None)
        self._add(taken, self._squares(drawn, taken) if self.exact else self._products(drawn, taken))

    def _products(self, drawn: Array, taken: Array) -> Array:
        """(n_actions, n_terms) products of two independent differences, whose mean errors of restoring do not move."""
        products, again = np.zeros(self.open.shape), self.trials.reward_without(drawn, [])
        for k in np.flatnonzero(self.open.any(1)):
            one, other = (self.trials.reward_without(drawn, [int(k)]) for _ in range(2))
            products[k] = (one - taken) * (other - again)
        return products

    def _squares(self, drawn: Array, taken: Array) -> Array:
        """(n_actions, n_terms) squared differences; those of a group that changes nothing are the group's."""
        squares = np.zeros(self.open.shape)
        alone, group = self._split()
        if group:
            together = (self.trials.reward_without(drawn, group) - taken) ** 2
            if (self._moves(together) & self.open.any(0)).any():
                alone += group
            else:
                squares[group] = together
        for k in alone:
            squares[k] = (self.trials.reward_without(drawn, [k]) - taken) ** 2
        return squares

    def _add(self, taken: Array, squares: Array) -> None:
        """Remember one state, unless something in it is not finite."""
        if not (np.isfinite(squares).all() and np.isfinite(taken).all()):
            self.refused += 1
            return
        self.moved += self._moves(squares)
        self.taken.append(taken)
        self.squares.append(squares)
        self.sequence.append(self.walk.sequence)

    def _split(self) -> tuple[list[int], list[int]]:
        """Actions to try alone and actions to try together."""
        candidates = [int(k) for k in np.flatnonzero(self.open.any(1))]
        if not self.taken:
            return candidates, []
        share = (self.moved[:, self.open.any(0)].max(1) + 1) / (len(self.taken) + 2)
        group = [k for k in candidates if share[k] < ALONE_FROM]
        if len(group) < 2:
            return candidates, []
        return [k for k in candidates if k not in group], group

    def _moves(self, squares: Array) -> NDArray[np.bool_]:
        """Whether squares (..., n_terms) show more than the effect of an absent edge would be."""
        return squares > ABSENT_BELOW * (np.var(self.taken, axis=0) if self.taken else 0.0)

    def look(self, rng: np.random.Generator) -> None:
        """Estimate the open edges from all states so far, and close those that are decided."""
        n, squares, taken = len(self.taken), np.array(self.squares), np.array(self.taken)
        found = effects(taken, squares, np.array(self.sequence), rng, CONFIDENCE)
        effect, low, high = (np.nan_to_num(x) for x in found)
        varies = np.isfinite(found[0])
        shown = self._moves(squares)
        with np.errstate(divide="ignore", invalid="ignore"):
            # What an event does where there is one, in variances of the term; at least 1.
            size = np.fmax(1.0, np.where(shown, squares, 0.0).sum((0, 1)) / shown.sum((0, 1)) / taken.var(0))
        unseen = UNSEEN / n * (size if self.exact else 1.0)
        for table, now in ((self.effect, effect), (self.low, low), (self.high, high + unseen)):
            table[self.open] = now[self.open]
        self.pairs[self.open] = n
        self.open &= ~(varies & ((self.low > ABSENT_BELOW) | (self.high < STRONG_ABOVE)))

    def graph(self) -> StageGraph:
        """The decisions; an edge that is still open is undecided."""
        walk = self.walk
        testable = varies(np.array(self.taken))
        present = ~self.open & (self.low > ABSENT_BELOW)
        names = ("effect", "effect_low", "effect_high", "pairs")
        evidence = dict(zip(names, (self.effect, self.low, self.high, self.pairs), strict=True))
        undecided = [
            f"{walk.task.actions[k]} on {walk.terms[j]} was not decided within the budget"
            for k, j in np.argwhere(self.open & testable)
        ]
        notes = tuple(undecided)
        return StageGraph.decided(walk.task, walk.stage, present, testable, evidence, notes, self.open)


EVIDENCE = (
    EvidenceColumn("effect", "", "estimate of E[(r_j(s, a) - r_j(s, a with a_k = 0))^2] / Var(r_j)", main=True,
                   log_range=(1e-3, 2.0)),
    EvidenceColumn("effect_low", "", "lower bound of the effect's interval when the edge was last looked at"),
    EvidenceColumn("effect_high", "", "upper bound of that interval, with room for what the states did not show"),
    EvidenceColumn("pairs", "states", "states in which the action was compared with 0 until the edge was decided"),
)  # fmt: skip
DISCOVERER = Discoverer(
    "paired",
    discover_stage,
    "effect sizes from paired interventions, until each edge is decided",
    settings=PairedSettings,
    evidence=EVIDENCE,
    reads=NO_SAMPLES,
    requires=frozenset({Capability.RESTORE}),
)
