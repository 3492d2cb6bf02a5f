"""Step 1 of Algorithm 1: random, intervention and inference data of one stage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.samples.transitions import Floats, Samples
from causalbench.core.staged.env import action_columns, reset_worlds
from causalbench.core.tasks.stages import judge
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene
from causalbench.core.world.cameras import HEIGHT, WIDTH
from causalbench.core.world.facts import Facts


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
