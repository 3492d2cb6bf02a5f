"""Step 1 of Algorithm 1: random, intervention and inference data of one stage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.staged.worlds import Worlds
from causalbench.errors import LayoutDrawError


def collect(
    worlds: Worlds,
    stage: int,
    count: int,
    do: int | None,
    rng: np.random.Generator,
    sequence_length: int,
    n_placebos: int,
    on_step: Callable[[int], None],
    sensor: str = "",
    action_repeat: int = 1,
    by_step: bool = False,
) -> Samples:
    """`count` transitions under uniform random actions and placebos, action `do` (if any) held at 0.

    With `by_step` it is 0 in a random half of the steps, each drawn by itself. Throughout a sequence, as the paper has
    it, a_k = 0 comes with a_k = 0 in the step before, so that what the world remembers of it looks like an effect.

    A step is one action, held for `action_repeat` env steps. One that leaves the stage is kept with the old stage's
    reward, which is a function of (s, a); then the world is reset into the stage. Dropping it would select samples by
    a consequence of the action. A sequence also ends after `sequence_length` steps, whatever `count` and the number of
    worlds, so that more data does not mean other states. `on_step(n)` is told of every n env steps taken. `sensor` is
    kept, too. `worlds` has a shape (n,).

    A step whose state or reward is not finite is left out and ends its sequence; after twice the planned number of
    steps there are fewer samples. Raises `LayoutDrawError` where the stage cannot be entered.
    """
    task, n = worlds.task, worlds.n
    terms = [task.term_names.index(name) for name in task.stage_terms(stage, discoverable_only=True)]
    n_actions = len(task.actions)
    length, over = np.zeros(n, dtype=int), np.ones(n, dtype=bool)
    sequence, n_sequences = np.zeros(n, dtype=np.int32), 0
    chunks: list[tuple[NDArray[Any], ...]] = []
    collected = tried = 0
    first = told = worlds.env_steps
    while collected < count and tried < 2 * max(count, n):
        restart = np.flatnonzero(over)
        if restart.size:
            try:
                worlds.reset(restart.tolist(), [rng] * restart.size, stage)
            except LayoutDrawError:
                on_step(worlds.env_steps - told)
                raise
            length[restart] = 0
            sequence[restart] = n_sequences + np.arange(restart.size)
            n_sequences += restart.size
        actions = rng.uniform(-1.0, 1.0, (n, n_actions + n_placebos))
        if do is not None:
            actions[rng.random(n) < 0.5 if by_step else slice(None), do] = 0.0
        states, frames = worlds.states(), worlds.sense(sensor)
        step = worlds.step(actions[:, :n_actions], action_repeat)
        rewards = step.rewards[:, terms].astype(np.float32)
        sound = np.isfinite(rewards).all(1) & np.isfinite(states).all(1) & np.isfinite(worlds.states()).all(1)
        columns_now = (states, actions.astype(np.float32), rewards, sequence, frames)
        chunks.append(tuple(column[sound] for column in columns_now))
        collected += int(sound.sum())
        tried += n
        on_step(worlds.env_steps - told)
        told = worlds.env_steps
        length += 1
        over = (step.next_stage != stage) | step.terminated | (length >= sequence_length) | ~sound
    states, acts, rewards, sequences, seen = (np.concatenate(column)[:count] for column in zip(*chunks, strict=True))
    steps, refused = worlds.env_steps - first, tried - collected
    return Samples(states, acts, rewards, sequences, steps, refused, sensor, (seen,) if sensor else ())
