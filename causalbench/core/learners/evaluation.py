"""Evaluation: full task episodes from stage 1 on fixed seeds, as many at a time as there are worlds."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.records import Episode, Evaluation
from causalbench.core.learners.registry import Policy
from causalbench.core.staged.worlds import Step, Worlds


@dataclass
class _Running:
    """The episode that one world is in."""

    number: int
    returns: NDArray[np.float64]
    stages: list[int] = field(default_factory=list)


class Player:
    """Plays episodes in worlds of shape (n,), each next one in the world that is free first.

    Start i is drawn with the seed `first_start` + i. Sampled episodes use the policy's own generator. Every success is
    put to the task's own test.
    """

    def __init__(self, worlds: Worlds, first_start: int) -> None:
        self.worlds, self.first_start = worlds, first_start
        self._running: dict[int, _Running] = {}  # by world

    def play(self, policy: Policy, numbers: Iterable[int], deterministic: bool) -> tuple[Episode, ...]:
        """The episodes from the starts `numbers`, in their order."""
        waiting, played = deque(numbers), dict[int, Episode]()
        order = [*waiting]
        self._begin(range(self.worlds.n), waiting)
        while self._running:
            actions, _ = policy.predict(self.worlds.observe(), deterministic=deterministic)
            ended = self._step(self.worlds.step(np.asarray(actions)))
            played |= {episode.episode: episode for episode in (self._end(*one, deterministic) for one in ended)}
            self._begin([world for world, _, _ in ended], waiting)
        return tuple(played[number] for number in order)

    def _begin(self, free: Sequence[int], waiting: deque[int]) -> None:
        """Start an episode in every free world. One without an episode is reset too, since all worlds are stepped."""
        if not free or not (waiting or self._running):
            return
        seeds = []
        for world in free:
            number = waiting.popleft() if waiting else None
            if number is not None:
                self._running[world] = _Running(number, np.zeros(len(self.worlds.task.term_names)))
            seeds.append(self.first_start + (number or 0))
        self.worlds.reset([*free], [np.random.default_rng(seed) for seed in seeds], 1)

    def _step(self, step: Step) -> list[tuple[int, bool, int]]:
        """Take in a step of all worlds; world, success and next stage of every episode that ended with it."""
        ended = []
        for world, episode in self._running.items():
            episode.returns += step.rewards[world]
            episode.stages.append(int(step.stage[world]))
            if step.terminated[world] or len(episode.stages) >= self.worlds.task.horizon:
                ended.append((world, bool(step.success[world]), int(step.next_stage[world])))
        return ended

    def _end(self, world: int, success: bool, next_stage: int, deterministic: bool) -> Episode:
        episode, task = self._running.pop(world), self.worlds.task
        return Episode(
            episode=episode.number,
            deterministic=deterministic,
            success=success,
            held=self.worlds.after_success(world) if success else None,
            n_stages=task.n_stages,
            stages=tuple(episode.stages),
            final_stage=task.n_stages + 1 if success else next_stage,
            returns=dict(zip(task.term_names, map(float, episode.returns), strict=True)),
        )


def summary(
    env_steps: int, certain: Sequence[Episode], sampled: Sequence[Episode], success_sampled: float | None
) -> Evaluation:
    """What deterministic episodes, and sampled ones if there are any, say of the policy after `env_steps`."""
    tested = [episode.held for episode in (*certain, *sampled) if episode.held is not None]
    returns = np.mean([[*episode.returns.values()] for episode in certain], axis=0)
    return Evaluation(
        env_steps=env_steps,
        episodes=len(certain),
        success_deterministic=float(np.mean([episode.success for episode in certain])),
        success_sampled=success_sampled,
        held_rate=float(np.mean(tested)) if tested else None,
        reversals_per_episode=float(np.mean([episode.reversals for episode in certain])),
        mean_final_stage=float(np.mean([episode.final_stage for episode in certain])),
        mean_length=float(np.mean([episode.length for episode in certain])),
        term_returns=dict(zip(certain[0].returns, map(float, returns), strict=True)),
        played=(*certain, *sampled),
    )
