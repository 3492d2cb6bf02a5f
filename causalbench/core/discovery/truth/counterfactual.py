"""Same state, other action: random sequences through a stage, from each state of which any action can be tried."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.worlds import Step, Worlds
from causalbench.core.world.capabilities import Capability

Array = NDArray[np.float64]


class Walk:
    """Visits states of `stage` as random sequences do: `visit`, then `take` what it drew and `reward_of` anything else.

    A step is one action, held for `action_repeat` control steps. A sequence ends with a step that leaves the stage, and
    after `length` steps. `worlds` is one world, of shape (). Raises `UserError` where it cannot be restored.
    """

    def __init__(
        self, worlds: Worlds, stage: int, rng: np.random.Generator, length: int, action_repeat: int = 1
    ) -> None:
        worlds.require(Capability.RESTORE, "trying other actions in the same state")
        self.worlds, self.task, self.stage, self.length, self.rng = worlds, worlds.task, stage, length, rng
        self.action_repeat = action_repeat
        self.terms = self.task.stage_terms(stage, discoverable_only=True)
        self.exact = Capability.EXACT_RESTORE in worlds.capabilities
        self.sequence = -1  # number of the sequence that the state belongs to
        self.ended = self.finished = 0  # sequences that are over, and those of them that finished the stage
        self._columns = [self.task.term_names.index(name) for name in self.terms]
        self._over, self._left = True, 0
        self._start = self._after = b""  # snapshots of the visited state and of that after the drawn action
        self._elsewhere = False
        self.drawn: Array  # the random action (n_actions,) of the visited state
        self._inputs: NDArray[np.float32]

    def visit(self) -> Array:
        """Move to the next state; returns the random action (n_actions,) to take there. Raises `LayoutDrawError`."""
        if self._over:
            self.worlds.reset([0], [np.random.default_rng(int(self.rng.integers(2**31)))], self.stage)
            self._left = self.length
            self.sequence += 1
        elif self._elsewhere:
            self.worlds.restore([0], [self._after])
        self._start, self._inputs = self.worlds.snapshot(0), self.worlds.states()
        self.drawn = self.rng.uniform(-1.0, 1.0, len(self.task.actions))
        return self.drawn

    def take(self, action: Array) -> Array:
        """As `reward_of`, and the sequence goes on from there."""
        reward, step = self._try(action)
        self._left -= 1
        finished = int(step.next_stage) > self.stage or bool(step.success)
        fell_back = int(step.next_stage) < self.stage
        out_of_it = finished or fell_back or bool(step.terminated)
        self._over = out_of_it or self._left == 0 or not np.isfinite(reward).all()
        self.ended += self._over
        self.finished += finished
        self._after, self._elsewhere = self.worlds.snapshot(0), False
        return reward

    def reward_of(self, action: Array) -> Array:
        """(n_terms,) rewards of the stage's terms for `action` (n_actions,) in the visited state."""
        self._elsewhere = True
        return self._try(action)[0]

    def compare(self) -> Array:
        """(n_actions + 2, n_terms) rewards in the next state: the drawn action, it again, it with each action at 0."""
        drawn = self.visit()
        tried = np.tile(drawn, (len(drawn) + 1, 1))
        tried[np.arange(1, len(drawn) + 1), np.arange(len(drawn))] = 0.0
        others = [self.reward_of(action) for action in tried]
        return np.array([self.take(drawn), *others])

    def compare_twice(self) -> tuple[Array, Array]:
        """Two independent repetitions in the next state, each (n_actions + 1, n_terms) rewards.

        The first row is the drawn action's, the others its with each action at 0. Where restoring is inexact the errors
        of the two are independent, so that the product of their differences has no floor.
        """
        drawn = self.visit()
        tried = np.tile(drawn, (len(drawn) + 1, 1))
        tried[np.arange(1, len(drawn) + 1), np.arange(len(drawn))] = 0.0
        again = np.array([self.reward_of(action) for action in tried])
        others = [self.reward_of(action) for action in tried[1:]]
        return np.array([self.take(drawn), *others]), again

    def _try(self, action: Array) -> tuple[Array, Step]:
        self.worlds.restore([0], [self._start])
        step = self.worlds.step(action, self.action_repeat)
        return step.rewards[self._columns], step

    def model_inputs(self) -> NDArray[np.float32]:
        """(n_inputs,) the visited state, as in `Samples`."""
        return self._inputs
