"""The buffer of an agent that sees, against a plain list of all transitions."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
import torch

from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.frame_buffer import FrameBuffer
from causalbench.core.networks.encoder import SENSORS, Sensor

TINY = Sensor((2, 2, 3), 255.0, torch.uint8, ())
N_STATE, CAPACITY, WORLDS = 3, 40, 2


class Worlds:
    """Worlds whose steps come with frames that never repeat; episodes are left (done) or cut off now and then."""

    def __init__(self, seed: int, cut_off: float = 0.1) -> None:
        self.rng, self.count, self.cut_off = np.random.default_rng(seed), 0, cut_off
        self.now = [self.observation() for _ in range(WORLDS)]

    def observation(self) -> torch.Tensor:
        self.count += 1
        frame = np.frombuffer(np.array([self.count], dtype="<u8").tobytes() + bytes(4), np.uint8)
        return torch.tensor([*self.rng.normal(size=N_STATE), *frame.astype(np.float32)], dtype=torch.float32)

    def step(self) -> Batch:
        """One step of every world; its reward is its own number."""
        obs, after, done = list(self.now), [self.observation() for _ in range(WORLDS)], np.zeros(WORLDS)
        for i in range(WORLDS):
            done[i] = self.rng.random() < 0.15
            over = done[i] or self.rng.random() < self.cut_off
            self.now[i] = self.observation() if over else after[i]
        rewards = torch.tensor([[float(self.count * WORLDS + i)] for i in range(WORLDS)])
        actions = torch.from_numpy(self.rng.normal(size=(WORLDS, 2))).float()
        return Batch(torch.stack(obs), actions, rewards, torch.stack(after), torch.from_numpy(done).float())


def make() -> FrameBuffer:
    return FrameBuffer(CAPACITY, N_STATE + TINY.size, 2, 1, TINY)


def by_reward(batch: Batch) -> dict[float, tuple[torch.Tensor, ...]]:
    rows = zip(*batch, strict=True)
    return {float(row[2]): row for row in rows}


def check(buffer: FrameBuffer, expected: dict[float, tuple[torch.Tensor, ...]]) -> None:
    """Every transition is found as it came in; what a finished step led to does not matter."""
    found = by_reward(buffer.sample(2_000, torch.Generator().manual_seed(0)))
    assert set(found) == set(expected)
    for number, (obs, actions, _, after, done) in expected.items():
        assert torch.equal(found[number][0], obs)
        assert torch.equal(found[number][1], actions)
        assert found[number][4] == done
        if not done:
            assert torch.equal(found[number][3], after)


@pytest.mark.parametrize("steps", [5, 20, 21, 200])
def test_it_holds_the_newest_transitions_whole(steps: int) -> None:
    worlds, buffer, newest = Worlds(steps), make(), deque(maxlen=CAPACITY)
    for _ in range(steps):
        batch = worlds.step()
        buffer.add(batch)
        newest += by_reward(batch).items()
    assert buffer.size == len(newest)
    check(buffer, dict(newest))


def test_a_frame_is_kept_once() -> None:
    """One a transition, one more for each episode that was cut off or still goes on, none for what ended one."""
    worlds, buffer = Worlds(1, cut_off=0.0), FrameBuffer(1_000, N_STATE + TINY.size, 2, 1, TINY)
    for _ in range(400):
        buffer.add(worlds.step())
    assert buffer.size <= buffer.n_seen <= buffer.size + WORLDS
    assert buffer.frames.dtype == torch.uint8


def test_many_cut_off_episodes_shorten_the_memory_and_spoil_nothing() -> None:
    worlds, buffer, newest = Worlds(2, cut_off=1.0), make(), deque(maxlen=CAPACITY)
    buffer.frames = buffer.frames[:50]  # room for 50 frames, but 40 transitions without any in common have 75 or so
    for _ in range(100):
        batch = worlds.step()
        buffer.add(batch)
        newest += by_reward(batch).items()
    assert 20 < buffer.size < CAPACITY
    check(buffer, dict(list(newest)[-buffer.size :]))


@pytest.mark.parametrize("steps", [7, 150])
def test_a_restored_buffer_goes_on_the_same(steps: int) -> None:
    worlds, buffer, other = Worlds(3), make(), make()
    for _ in range(steps):
        buffer.add(worlds.step())
    other.load_state({k: v.clone() if isinstance(v, torch.Tensor) else v for k, v in buffer.state().items()})
    for _ in range(30):
        batch = worlds.step()
        buffer.add(batch)
        other.add(batch)
        for ours, theirs in zip(
            *(b.sample(50, torch.Generator().manual_seed(1)) for b in (buffer, other)), strict=True
        ):
            assert torch.equal(ours, theirs)


def test_ten_thousand_images_take_a_hundred_megabytes() -> None:
    """As docs/learners.md says, for one stage of the paper's pure manipulation."""
    buffer = FrameBuffer(10_000, 15 + SENSORS["rgb"].size, 7, 3, SENSORS["rgb"])
    assert buffer.frames.nbytes == 11_314 * 9_216
