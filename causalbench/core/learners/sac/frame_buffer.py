"""The replay buffer of an agent that sees: every image or scan is kept once, in its own type."""

from __future__ import annotations

import torch
from torch import Tensor

from causalbench.core.learners.sac.buffer import Batch, StageBuffer
from causalbench.core.networks.encoder import Sensor
from causalbench.core.networks.state import State

SPARE = 64  # frames, beside an eighth of the capacity, for what steps of cut-off episodes led to


class FrameBuffer(StageBuffer):
    """As `StageBuffer`; the last numbers of an observation are a frame of `sensor`, and transitions refer to frames.

    What a step led to is what the next step of that world began with, so it is kept once. Of a step that ended the
    agent's episode it is not kept at all: its value does not count (`done`). Frames are numbered as they come; when
    cut-off episodes leave more frames than there is room for, the oldest transitions go first.
    """

    def __init__(self, capacity: int, n_obs: int, n_actions: int, n_critics: int, sensor: Sensor) -> None:
        super().__init__(capacity, n_obs - sensor.size, n_actions, n_critics)
        self.frames = torch.zeros(capacity + capacity // 8 + SPARE, sensor.size, dtype=sensor.dtype)
        self.n_seen = 0
        self.numbers = torch.zeros(capacity, 2, dtype=torch.int64)  # of the frames before and after each transition
        self._latest: dict[bytes, int] = {}  # numbers of the frames that the last steps led to

    def add(self, transitions: Batch) -> None:
        """See `StageBuffer`."""
        n, n_state = len(transitions.done), self.data.obs.shape[1]
        before, after = (x[:, n_state:].to(self.frames.dtype) for x in (transitions.obs, transitions.next_obs))
        numbers, latest = torch.zeros(n, 2, dtype=torch.int64), {}
        for i in range(n):
            known = self._latest.get(before[i].numpy().tobytes())
            first = second = self._keep(before[i]) if known is None else known
            if not transitions.done[i]:
                second = latest[after[i].numpy().tobytes()] = self._keep(after[i])
            numbers[i, 0], numbers[i, 1] = first, second
        self._latest = latest
        self.numbers[(self.position + torch.arange(n)) % self.capacity] = numbers
        super().add(transitions._replace(obs=transitions.obs[:, :n_state], next_obs=transitions.next_obs[:, :n_state]))
        while int(self.numbers[(self.position - self.size) % self.capacity, 0]) < self.n_seen - len(self.frames):
            self.size -= 1

    def _keep(self, frame: Tensor) -> int:
        self.frames[self.n_seen % len(self.frames)] = frame
        self.n_seen += 1
        return self.n_seen - 1

    def sample(self, batch_size: int, generator: torch.Generator) -> Batch:
        """See `StageBuffer`."""
        rows = (self.position - 1 - torch.randint(self.size, (batch_size,), generator=generator)) % self.capacity
        found = Batch(*(store[rows] for store in self.data))
        before, after = (self.frames[self.numbers[rows, side] % len(self.frames)].float() for side in (0, 1))
        return found._replace(obs=torch.cat([found.obs, before], 1), next_obs=torch.cat([found.next_obs, after], 1))

    def state(self) -> State:
        """Transitions from the oldest to the newest, and the frames that they refer to."""
        rows = (self.position - self.size + torch.arange(self.size)) % self.capacity
        held: State = {name: store[rows] for name, store in self.data._asdict().items()}
        first = int(self.numbers[rows].min()) if self.size else self.n_seen
        kept = torch.arange(first, self.n_seen) % len(self.frames)
        latest = torch.tensor(list(self._latest.values()), dtype=torch.int64)
        numbered = {"numbers": self.numbers[rows] - first, "latest": latest - first, "frames": self.frames[kept]}
        return held | numbered | {"position": self.size % self.capacity, "new": self.new}

    def load_state(self, state: State) -> None:
        """What `state` gave to a buffer of the same capacity."""
        super().load_state(state)
        self.numbers[: self.size], self.n_seen = state["numbers"], len(state["frames"])
        self.frames[: self.n_seen] = state["frames"]
        self._latest = {self.frames[k].numpy().tobytes(): k for k in state["latest"].tolist()}
