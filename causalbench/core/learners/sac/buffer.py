"""The replay buffer of one stage's agent: preallocated tensors, one reward column per critic."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from causalbench.core.networks.state import State


class Batch(NamedTuple):
    """Sampled transitions, float32. `done` is 1 where the stage changed or the world ended, never at time limits."""

    obs: Tensor  # (batch, n_obs)
    actions: Tensor  # (batch, n_actions) of the agent's own actions
    rewards: Tensor  # (batch, n_critics)
    next_obs: Tensor  # (batch, n_obs)
    done: Tensor  # (batch,)


class StageBuffer:
    """First in, first out, `capacity` transitions. `new` counts those added since training last ran."""

    def __init__(self, capacity: int, n_obs: int, n_actions: int, n_critics: int) -> None:
        self.capacity, self.size, self.position, self.new = capacity, 0, 0, 0
        self.widths = [n_obs, n_actions, n_critics, n_obs, 1]
        self.rows = torch.zeros(capacity, sum(self.widths))  # a transition a row: a batch is taken out in one go
        self.data = self._columns(self.rows)

    def add(self, transitions: Batch) -> None:
        """Append a batch of transitions, overwriting the oldest."""
        n = len(transitions.done)
        rows = (self.position + torch.arange(n)) % self.capacity
        for store, values in zip(self.data, transitions, strict=True):
            store[rows] = values
        self.position = (self.position + n) % self.capacity
        self.size = min(self.size + n, self.capacity)
        self.new += n

    def sample(self, batch_size: int, generator: torch.Generator) -> Batch:
        """Uniform, with replacement."""
        rows = torch.randint(self.size, (batch_size,), generator=generator)
        return self._columns(self.rows.index_select(0, rows))

    def _columns(self, rows: Tensor) -> Batch:
        obs, actions, rewards, next_obs, done = torch.split(rows, self.widths, 1)
        return Batch(obs, actions, rewards, next_obs, done[:, 0])

    def state(self) -> State:
        """The transitions it holds and its counters."""
        held = {name: store[: self.size] for name, store in self.data._asdict().items()}
        return held | {"position": self.position, "new": self.new}

    def load_state(self, state: State) -> None:
        """What `state` gave to a buffer of the same capacity."""
        self.size, self.position, self.new = len(state["done"]), state["position"], state["new"]
        for name, store in self.data._asdict().items():
            store[: self.size] = state[name]
