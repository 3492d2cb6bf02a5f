"""When a learner is evaluated, and by whom: an examiner with worlds of its own, which does no work twice."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from causalbench.core.learners.evaluation import Player, summary
from causalbench.core.learners.records import Episode, Evaluation, TrainingCounts
from causalbench.core.learners.registry import Policy, TrainingProblem
from causalbench.core.staged.worlds import Worlds

MOST_WORLDS = 50
"""Worlds that an evaluation has at most, where they step as one."""


class Examiner:
    """Reports how far a training is, and evaluates its policy when this is due. Close it at the end.

    Deterministic episodes are played together where worlds step as one, and not again while no weight has changed.
    Before the last evaluation the success of sampled actions is that of the training episodes since the one before.
    """

    def __init__(self, problem: TrainingProblem) -> None:
        self.problem = problem
        self.evaluations: list[Evaluation] = []
        """All evaluations so far."""
        self.settled = False
        """Whether training has ended before its budget, see `EvaluationSettings.stop_after`."""
        self.worlds = _worlds(problem)
        self._player = Player(self.worlds, problem.evaluation.first_start)
        self._certain: tuple[Episode, ...] = ()  # deterministic episodes of a policy after `_updates`
        self._updates: dict[int, int] = {}
        self._seen = (0, 0)  # training episodes, and successes among them, at the evaluation before

    def is_due(self, before: int, taken: int, doing: str) -> bool:
        """Report the env steps `taken` and say whether those since `before` make an evaluation due.

        The steps that reach the budget do. `doing` is a few words for people.
        """
        problem = self.problem
        problem.on_progress(min(1.0, taken / problem.env_steps), doing)
        return problem.evaluation.episodes_due(before, taken, problem.env_steps) > 0

    def examine(self, policy: Policy, counts: TrainingCounts) -> Evaluation:
        """Evaluate `policy` after the steps in `counts`, and hand both on; the last time with more episodes.

        The last time is at the budget, or when enough evaluations in a row saw no failure: `settled` is then true.
        `counts.updates` must be those of `policy`.
        """
        last = counts.env_steps >= self.problem.env_steps
        found = self._final(policy, counts) if last else self._look(policy, counts)
        if not last and self._without_failure(found):
            self.settled = True
            found = self._final(policy, counts)
        self._seen = counts.episodes, counts.successes
        self.evaluations.append(found)
        self.problem.on_evaluation(found, counts)
        return found

    def _look(self, policy: Policy, counts: TrainingCounts) -> Evaluation:
        """An evaluation before the last one."""
        certain = self._deterministic(policy, self.problem.evaluation.episodes, counts)
        ended, successes = counts.episodes - self._seen[0], counts.successes - self._seen[1]
        found = summary(counts.env_steps, certain, (), successes / ended if ended else None)
        return dataclasses.replace(found, played=())

    def _final(self, policy: Policy, counts: TrainingCounts) -> Evaluation:
        number = self.problem.evaluation.final_episodes
        certain = self._deterministic(policy, number, counts)
        sampled = self._player.play(policy, range(number), deterministic=False)
        share = float(np.mean([episode.success for episode in sampled]))
        return summary(counts.env_steps, certain, sampled, share)

    def _deterministic(self, policy: Policy, number: int, counts: TrainingCounts) -> tuple[Episode, ...]:
        """The episodes from the first `number` starts; those that this very policy has played are not repeated."""
        if counts.updates != self._updates or not any(counts.updates.values()):
            self._certain = ()
        self._updates = dict(counts.updates)
        self._certain += self._player.play(policy, range(len(self._certain), number), deterministic=True)
        return self._certain[:number]

    def _without_failure(self, newest: Evaluation) -> bool:
        """Whether `newest` is the last of so many evaluations in a row without a failure as end training."""
        row = self.problem.evaluation.stop_after
        recent = [*self.evaluations, newest][-row:]
        return 0 < row == len(recent) and all(found.success_deterministic == 1.0 for found in recent)

    def state(self) -> dict[str, Any]:
        """What later evaluations depend on, as JSON data."""
        return {
            "evaluations": [dataclasses.asdict(found) for found in self.evaluations],
            "certain": [dataclasses.asdict(episode) for episode in self._certain],
            "updates": [*self._updates.items()],
            "seen": [*self._seen],
        }

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from `state`."""
        self.evaluations = [Evaluation.from_record(record) for record in state["evaluations"]]
        self._certain = tuple(map(Episode.from_record, state["certain"]))
        self._updates = {int(stage): int(number) for stage, number in state["updates"]}
        self._seen = (state["seen"][0], state["seen"][1])

    def close(self) -> None:
        """Close the worlds."""
        self.worlds.close()


def _worlds(problem: TrainingProblem) -> Worlds:
    """One world, or one for each episode where several worlds step as one."""
    first = problem.worlds(1)
    settings = problem.evaluation
    number = min(max(settings.episodes, settings.final_episodes), MOST_WORLDS)
    if number == 1 or not first.steps_as_one:
        return first
    first.close()
    return problem.worlds(number)
