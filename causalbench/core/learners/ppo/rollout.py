"""What all worlds did in one epoch of on-policy sampling, and its factored advantages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from causalbench.core.networks.state import State


class Steps(NamedTuple):
    """Control steps in time order, n_steps of n_envs worlds each.

    `actions` are those that were drawn, before the environment's bounds clipped them. `stage` (1-based) is the one that
    the step began in; `done` where it changed or the world terminated, `over` where the task's episode ended.
    """

    obs: Tensor  # (n_steps, n_envs, n_obs)
    actions: Tensor  # (n_steps, n_envs, n_actions)
    rewards: Tensor  # (n_steps, n_envs, n_terms)
    next_obs: Tensor  # (n_steps, n_envs, n_obs), before any reset
    stage: Tensor  # (n_steps, n_envs) int64
    done: Tensor  # (n_steps, n_envs) bool
    over: Tensor  # (n_steps, n_envs) bool


class Rollout:
    """Room for one epoch, filled step by step."""

    def __init__(self, n_steps: int, n_envs: int, n_obs: int, n_actions: int, n_terms: int) -> None:
        self.length = 0
        shape = (n_steps, n_envs)
        self.steps = Steps(
            torch.zeros(*shape, n_obs),
            torch.zeros(*shape, n_actions),
            torch.zeros(*shape, n_terms),
            torch.zeros(*shape, n_obs),
            torch.zeros(shape, dtype=torch.int64),
            torch.zeros(shape, dtype=torch.bool),
            torch.zeros(shape, dtype=torch.bool),
        )

    @property
    def full(self) -> bool:
        """Whether the epoch has all its steps."""
        return self.length == len(self.steps.stage)

    def add(self, step: Steps) -> None:
        """Append one step of every world; `step` has no leading time dimension."""
        for store, values in zip(self.steps, step, strict=True):
            store[self.length] = values
        self.length += 1

    def state(self) -> State:
        """The steps taken so far."""
        return {name: store[: self.length] for name, store in self.steps._asdict().items()}

    def load_state(self, state: State) -> None:
        """What `state` gave to a rollout of the same size."""
        self.length = len(state["stage"])
        for name, store in self.steps._asdict().items():
            store[: self.length] = state[name]


def gae(
    rewards: NDArray[np.float32],
    values: NDArray[np.float32],
    next_values: NDArray[np.float32],
    goes_on: NDArray[np.bool_],
    gamma: float,
    gae_lambda: float,
) -> NDArray[np.float32]:
    """Generalised advantage estimates (n_steps, n_envs, n_critics), one per critic (Schulman et al. 2016, eq. 16).

    `next_values` are 0 where the agent's episode ended and the value of the state reached where time ran out;
    `goes_on` (n_steps, n_envs) says where the following step belongs to the same episode of the same agent. A step of
    another agent has no advantage here, and whatever its row holds reaches no other row.
    """
    delta = rewards + gamma * next_values - values
    decay = (np.float32(gamma * gae_lambda) * goes_on)[..., None]
    advantages = np.empty_like(delta)
    running = np.zeros_like(delta[0])
    for t in reversed(range(len(delta))):
        running = delta[t] + decay[t] * running
        advantages[t] = running
    return advantages
