"""What discovery learns from: transitions of one stage, and the sets of them that Algorithm 1 names."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

ROUNDING = 1e-7
"""About what is lost when a number becomes one of the float32 that samples keep."""


@dataclass(frozen=True)
class Samples:
    """Transitions of one stage, one row per step. The last columns of `actions` are placebos, which no world reads."""

    states: Floats  # (n, n_inputs): what `Worlds.states` says; names in `StageTask.input_names`
    actions: Floats  # (n, n_actions + n_placebos)
    rewards: Floats  # (n, n_terms of the stage)
    sequence: NDArray[np.int32]  # (n,) number of the uninterrupted sequence that each step belongs to
    env_steps: int  # taken to collect them
    refused: int = 0  # steps left out since a state or a reward was not finite
    sensor: str = ""  # what was observed beside the state, see `encoder.SENSORS`
    frames: tuple[NDArray[Any], ...] = ()  # blocks (m, size) of what the sensor said before each step, n in all

    def __len__(self) -> int:
        return len(self.states)

    def without(self, k: int) -> Samples:
        """A copy in which action k is not executed: the paper's copy of D_inference."""
        actions = self.actions.copy()
        actions[:, k] = 0.0
        return replace(self, actions=actions)

    def joined(self, other: Samples) -> Samples:
        """These and then those of `other`, whose sequences are numbered on."""
        columns = ((self.states, other.states), (self.actions, other.actions), (self.rewards, other.rewards))
        states, actions, rewards = (np.concatenate(pair) for pair in columns)
        sequence = np.concatenate([self.sequence, other.sequence + self.sequence[-1] + 1])
        steps, refused = self.env_steps + other.env_steps, self.refused + other.refused
        # Frames are large, and D_random is joined with every D_do: blocks are not copied.
        return Samples(states, actions, rewards, sequence, steps, refused, self.sensor, self.frames + other.frames)

    def first(self, count: int) -> Samples:
        """The first `count` samples, with the share of the steps that they took."""
        if count >= len(self):
            return self
        rows = slice(count)
        steps = math.ceil(self.env_steps * count / len(self))
        kept, frames = count, []
        for block in self.frames:
            frames.append(block[:kept])
            kept -= len(frames[-1])
        return Samples(
            self.states[rows], self.actions[rows], self.rewards[rows], self.sequence[rows], steps, self.refused,
            self.sensor, tuple(frames),
        )  # fmt: skip

    def frames_of(self, rows: NDArray[np.int64]) -> NDArray[Any]:
        """What the sensor said before the steps `rows` (m,): (m, size)."""
        ends = np.cumsum([len(block) for block in self.frames])
        out = np.empty((len(rows), self.frames[0].shape[1]), self.frames[0].dtype)
        for block, end in zip(self.frames, ends, strict=True):
            inside = (rows < end) & (rows >= end - len(block))
            out[inside] = block[rows[inside] - (end - len(block))]
        return out

    def term_scale(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(deviation (n_terms,), testable (n_terms,)): a term that never varies cannot be tested; its scale is 1."""
        testable = varies(self.rewards)
        return np.where(testable, self.rewards.astype(np.float64).std(0), 1.0), testable

    def digest(self) -> str:
        """SHA-256 of the raw data, hex."""
        parts = (self.states, self.actions, self.rewards, self.sequence, *self.frames)
        return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in parts)).hexdigest()


@dataclass(frozen=True)
class StageSamples:
    """All samples of one stage (paper, Algorithm 1). `interventions[k]` is D_do[a_k], as long as `extra`.

    `extra` is one more random set, which placebos are drawn into; None without placebos. `notes` says what is unusual
    about them, a sentence each.
    """

    random: Samples
    inference: Samples
    interventions: tuple[Samples, ...]
    extra: Samples | None = None
    notes: tuple[str, ...] = ()

    def digest(self) -> str:
        """SHA-256 of the raw data, hex."""
        parts = [self.random, self.inference, *self.interventions]
        if self.extra is not None:
            parts.append(self.extra)
        return hashlib.sha256("".join(samples.digest() for samples in parts).encode()).hexdigest()


def varies(rewards: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Return which columns of `rewards` (n, n_terms) vary by more than rounding, bool (n_terms,).

    No cause can be found of the others.

    The one rule of the package, the same in every unit: a deviation above `ROUNDING` of the largest value.
    """
    spread = rewards.astype(np.float64).std(0)
    return np.asarray(spread > ROUNDING * np.abs(rewards.astype(np.float64)).max(0, initial=0.0))
