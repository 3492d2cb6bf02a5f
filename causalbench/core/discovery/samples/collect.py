"""Step 1 of Algorithm 1: random, intervention and inference data of one stage."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.env import action_columns, reset_worlds
from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene
from causalbench.core.world.cameras import HEIGHT, WIDTH
from causalbench.core.world.scene import Facts

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Samples:
    """Transitions of one stage. `actions` has the task's actions and, last, the placebos that no scene sees."""

    states: Floats  # (n, n_state + 1): the paper's variables and the gripper opening
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
        scale = self.rewards.astype(np.float64).std(0)
        testable = scale > 1e-6 * np.abs(self.rewards).max(0).clip(min=1.0)
        return np.where(testable, scale, 1.0), testable

    def digest(self) -> str:
        """SHA-256 of the raw data, hex."""
        parts = (self.states, self.actions, self.rewards, self.sequence, *self.frames)
        return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in parts)).hexdigest()


@dataclass(frozen=True)
class StageSamples:
    """All that Algorithm 1 collects in one stage; `interventions[k]` is D_do[a_k], all of one length with `extra`.

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


def collect(
    task: Task,
    batch: BatchScene,
    stage: int,
    count: int,
    do: int | None,
    rng: np.random.Generator,
    sequence_length: int,
    n_placebos: int,
    on_step: Callable[[int], None],
    sensor: str = "",
    action_repeat: int = 1,
) -> Samples:
    """`count` transitions under uniform random actions and placebos, action `do` (if any) held at 0.

    A step is one action, held for `action_repeat` env steps. One that leaves the stage is kept with the old stage's
    reward, which is a function of (s, a); then the world is reset into the stage. Dropping it would select samples by
    a consequence of the action. A sequence also ends after `sequence_length` steps, whatever `count` and the number of
    worlds, so that more data does not mean other states. `on_step(n)` is told of every n env steps taken. `sensor` is
    kept, too.

    A step whose state or reward is not finite is left out and ends its sequence; after twice the planned number of
    steps there are fewer samples. Raises `LayoutDrawError` where the stage cannot be entered.
    """
    columns = action_columns(task, batch.spec)
    terms = [task.term_names.index(name) for name in task.stage_terms(stage, discoverable_only=True)]
    n_actions = len(task.actions)
    full = np.zeros((batch.n, len(batch.spec.actions)))
    inside, length = np.full(batch.n, stage), np.zeros(batch.n, dtype=int)
    over = np.ones(batch.n, dtype=bool)
    sequence, n_sequences = np.zeros(batch.n, dtype=np.int32), 0
    chunks: list[tuple[NDArray[Any], ...]] = []
    collected = tried = 0
    while collected < count and tried < 2 * max(count, batch.n):
        restart = np.flatnonzero(over)
        if restart.size:
            reset_worlds(task, batch, restart.tolist(), [rng] * restart.size, stage)
            length[restart] = 0
            sequence[restart] = n_sequences + np.arange(restart.size)
            n_sequences += restart.size
            before = batch.facts()
        actions = rng.uniform(-1.0, 1.0, (batch.n, n_actions + n_placebos))
        if do is not None:
            actions[:, do] = 0.0
        full[:, columns] = actions[:, :n_actions]
        frames = sense(batch, sensor)
        for _ in range(action_repeat):
            batch.step(full)
        now = batch.facts()
        result = judge(task, inside, before, actions[:, :n_actions], now)
        rewards = result.vector_reward[:, terms].astype(np.float32)
        states = model_inputs(task, before)
        sound = np.isfinite(rewards).all(1) & np.isfinite(states).all(1) & np.isfinite(model_inputs(task, now)).all(1)
        columns_now = (states, actions.astype(np.float32), rewards, sequence, frames)
        chunks.append(tuple(column[sound] for column in columns_now))
        collected += int(sound.sum())
        tried += batch.n
        on_step(batch.n * action_repeat)
        length += 1
        over = (result.next_stage != stage) | result.success | (length >= sequence_length) | ~sound
        before = now
    states, acts, rewards, sequences, seen = (np.concatenate(column)[:count] for column in zip(*chunks, strict=True))
    steps, refused = tried * action_repeat, tried - collected
    return Samples(states, acts, rewards, sequences, steps, refused, sensor, (seen,) if sensor else ())


def sense(batch: BatchScene, sensor: str) -> NDArray[Any]:
    """(n, size) what `sensor` says in every world; size 0 without one."""
    if sensor == "rgb":
        return batch.render(WIDTH, HEIGHT).reshape(batch.n, -1)
    return batch.lidar().astype(np.float32) if sensor == "lidar" else np.empty((batch.n, 0), np.uint8)


def model_inputs(task: Task, facts: Facts) -> Floats:
    """(..., n_state + 1) what the reward model sees of the state: all that the rewards depend on."""
    opening = np.asarray(facts.gripper_opening)[..., None]
    return np.concatenate([task.observe(facts), opening], axis=-1).astype(np.float32)
