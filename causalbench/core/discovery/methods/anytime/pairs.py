"""Paired interventions of one stage: in visited states, the drawn action against it with actions at 0."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.methods.trials import Trials
from causalbench.core.discovery.truth.effects import ABSENT_BELOW

if TYPE_CHECKING:
    from causalbench.core.discovery.truth.counterfactual import Walk

Array = NDArray[np.float64]

EVERY = 2  # of how many visited states one is compared while each action is tried alone: neighbours resemble each other
FEW = 2  # actions that are tried alone in every state
ALONE_FROM = 1 / 3  # an action that had an effect in at least this share of states is not tried in a group


class Compared(NamedTuple):
    """What one state showed, each (n_actions, n_terms).

    `square` is the squared difference, or the product of two independent ones where restoring is inexact; `spread` how
    much more two tries with the action at 0 differ than two without, squared: 0 where restoring is exact.
    """

    square: Array
    spread: Array


class Pairs:
    """What was measured of one stage so far, and the walk that goes on measuring."""

    def __init__(self, walk: Walk) -> None:
        self.walk, self.exact, self.trials = walk, walk.exact, Trials(walk)
        self.shape = (len(walk.task.actions), len(walk.terms))
        self.taken: list[Array] = []  # (n_terms,) of every visited state
        self.compared: list[Compared] = []
        self.measured: list[NDArray[np.bool_]] = []  # (n_actions,), one a compared state
        self.refused = self.visited = 0
        self._cheap = False  # whether almost all actions are tried together by now

    @property
    def most(self) -> int:
        """Control steps that one more state takes at most."""
        n = self.shape[0]
        return (n + 2 if self.exact else 2 * n + 2) * self.walk.action_repeat

    def visit(self, open_edges: NDArray[np.bool_]) -> None:
        """One more state, compared for the actions of `open_edges` (n_actions, n_terms) if it is its turn."""
        drawn = self.walk.visit()
        taken = self.trials.reward_without(drawn, None)
        self.visited += 1
        found = None
        if self.visited % EVERY == 0 or self._cheap:
            actions = np.flatnonzero(open_edges.any(1))
            found = (
                self._exactly(drawn, taken, actions, open_edges) if self.exact else self._twice(drawn, taken, actions)
            )
        if not np.isfinite(taken).all() or (found and not np.isfinite(found).all()):
            self.refused += 1
            return
        self.taken.append(taken)
        if found:
            self.compared.append(found)
            self.measured.append(open_edges.any(1))

    def _exactly(
        self, drawn: Array, taken: Array, actions: NDArray[np.int64], open_edges: NDArray[np.bool_]
    ) -> Compared:
        """Actions that hardly ever had an effect are set to 0 together first: if that changes nothing, none did."""
        square = np.zeros(self.shape)
        alone, group = self._split(actions, open_edges)
        self._cheap = len(alone) <= FEW
        if len(group) > 1:
            together = (self.trials.reward_without(drawn, group) - taken) ** 2
            if (together > ABSENT_BELOW * np.var(self.taken or [taken], axis=0))[open_edges.any(0)].any():
                alone += group
            else:
                square[group] = together
        else:
            alone += group
        for k in alone:
            square[k] = (self.trials.reward_without(drawn, [k]) - taken) ** 2
        return Compared(square, np.zeros(self.shape))

    def _twice(self, drawn: Array, taken: Array, actions: NDArray[np.int64]) -> Compared:
        product, spread = np.zeros(self.shape), np.zeros(self.shape)
        again = self.trials.reward_without(drawn, [])
        for k in actions:
            one, other = (self.trials.reward_without(drawn, [int(k)]) for _ in range(2))
            product[k] = (one - taken) * (other - again)
            spread[k] = (one - other) ** 2 - (taken - again) ** 2
        return Compared(product, spread)

    def _split(self, actions: NDArray[np.int64], open_edges: NDArray[np.bool_]) -> tuple[list[int], list[int]]:
        """Actions to try alone and actions to try together."""
        if not self.compared:
            return actions.tolist(), []
        moved = np.mean([c.square > ABSENT_BELOW * self.variance for c in self.compared[-50:]], axis=0)
        rare = np.where(open_edges, moved, 0.0).max(1) < ALONE_FROM
        return [k for k in actions.tolist() if not rare[k]], [k for k in actions.tolist() if rare[k]]

    @property
    def variance(self) -> Array:
        """(n_terms,) of the rewards of random actions."""
        return np.var(self.taken, axis=0)
