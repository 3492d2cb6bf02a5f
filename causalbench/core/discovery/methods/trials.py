"""What methods that compare actions in the same state have in common: every step that they try is counted and kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.samples.transitions import Samples

if TYPE_CHECKING:
    from causalbench.core.discovery.truth.counterfactual import Walk

Array = NDArray[np.float64]


class Trials:
    """The steps that were tried in the states of `walk`; `env_steps` of the world in all."""

    def __init__(self, walk: Walk) -> None:
        self.walk, self.env_steps = walk, 0
        self._steps: list[tuple[NDArray[np.float32], Array, Array, int]] = []  # state, action, rewards, sequence

    def reward_without(self, drawn: Array, off: list[int] | None) -> Array:
        """Rewards (n_terms,) of the drawn action with those in `off` at 0; None takes it."""
        action = drawn.copy()
        action[off or []] = 0.0
        reward = self.walk.take(action) if off is None else self.walk.reward_of(action)
        self.env_steps += self.walk.action_repeat
        self._steps.append((self.walk.model_inputs(), action, reward, self.walk.sequence))
        return reward

    def samples(self, refused: int) -> Samples:
        """Every step: of each state first the drawn action, then what it was compared with.

        `refused` is how many states something was not finite in.
        """
        states, actions, rewards, sequence = (np.array(column) for column in zip(*self._steps, strict=True))
        columns = actions.astype(np.float32), rewards.astype(np.float32), sequence.astype(np.int32)
        return Samples(states, *columns, self.env_steps, refused)
