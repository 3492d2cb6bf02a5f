"""What the staged loop asks of a learner. One implementation a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.policy import StagedPolicy
from causalbench.core.networks.state import State
from causalbench.core.staged.observation import Observation
from causalbench.errors import DivergedError


class StagedLearner(Protocol):
    """What `train_staged` asks of a learner, which holds the agents of all stages and gives each step to one."""

    policy: StagedPolicy
    """Shares its weights with the agents, so that it is always the newest."""

    def act(self, obs: Observation) -> NDArray[np.float64]:
        """Exploring actions (n, n_actions) for n worlds."""

    def remember(
        self, obs: Observation, actions: NDArray[Any], infos: Mapping[str, Any], over: NDArray[np.bool_]
    ) -> None:
        """Take in one step of every world: what `act` saw and chose, the `infos` it led to, whose episode ended."""

    def train(self) -> None:
        """Called after every step; updates the agents that are due. Raises `DivergedError`."""

    def updates(self) -> dict[int, int]:
        """Stage (from 1) -> gradient updates so far."""

    def state(self) -> State:
        """Everything that later steps depend on; tensors may be views of what goes on changing."""

    def load_state(self, state: State) -> None:
        """Go on as the learner that `state` came from, one made with the same arguments."""


@contextmanager
def diverging_in(stage: int) -> Iterator[None]:
    """A `DivergedError` from within names the stage."""
    try:
        yield
    except DivergedError as error:
        raise DivergedError(f"stage {stage}: {error}") from error
