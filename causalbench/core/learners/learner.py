"""What the training loop asks of a learner. One implementation a file; `training.LEARNERS` names them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from causalbench.core.env import Observation
from causalbench.core.learners.policy import StagedPolicy
from causalbench.errors import DivergedError

State = dict[str, Any]
"""All that a continuation needs, flat: tensors, and values that JSON keeps exactly (numbers, texts, lists, dicts)."""


class StagedLearner(Protocol):
    """Agents of all stages and the routing between them."""

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


def prefixed(prefix: str, state: Mapping[str, Any]) -> State:
    """`state` with `prefix.` before each name."""
    return {f"{prefix}.{name}": value for name, value in state.items()}


def below(prefix: str, state: Mapping[str, Any]) -> State:
    """What `prefixed(prefix, ...)` put into `state`."""
    start = f"{prefix}."
    return {name.removeprefix(start): value for name, value in state.items() if name.startswith(start)}


def tensor_state(tensors: list[Tensor]) -> State:
    """Weights by their index."""
    return {str(k): tensor.detach() for k, tensor in enumerate(tensors)}


def load_tensors(tensors: list[Tensor], state: State) -> None:
    """Overwrite `tensors` in place: others hold references to them."""
    with torch.no_grad():
        for k, tensor in enumerate(tensors):
            tensor.copy_(state[str(k)])


def optimizer_state(optimizer: torch.optim.Optimizer) -> State:
    """The moments and step counts of every weight; empty before the first step."""
    moments = optimizer.state_dict()["state"]
    return {f"{k}.{name}": value for k, values in moments.items() for name, value in values.items()}


def load_optimizer(optimizer: torch.optim.Optimizer, state: State) -> None:
    """What `optimizer_state` gave; hyperparameters stay the optimiser's own."""
    moments: dict[int, dict[str, Any]] = {}
    for name, value in state.items():
        k, _, moment = name.partition(".")
        moments.setdefault(int(k), {})[moment] = value
    optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
