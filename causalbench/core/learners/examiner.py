"""When a learner is evaluated, and by whom: an examiner with an environment of its own."""

from __future__ import annotations

import dataclasses

from causalbench.core.learners.evaluation import evaluate
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.registry import Policy, TrainingProblem


class Examiner:
    """Tells how far a training run is and evaluates its policy whenever that is due; close it at the end."""

    def __init__(self, problem: TrainingProblem) -> None:
        self.problem, self.env = problem, problem.env()
        self.evaluations: list[Evaluation] = []
        """All evaluations so far."""
        self.settled = False
        """Whether training has ended before its budget, see `EvaluationSettings.stop_after`."""

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
        """
        last = counts.env_steps >= self.problem.env_steps
        found = self._evaluate(policy, counts.env_steps, last)
        if not last and self._without_failure(found):
            self.settled = True
            found = self._evaluate(policy, counts.env_steps, True)
        if not last and not self.settled:
            found = dataclasses.replace(found, played=())
        self.evaluations.append(found)
        self.problem.on_evaluation(found, counts)
        return found

    def _evaluate(self, policy: Policy, taken: int, last: bool) -> Evaluation:
        settings = self.problem.evaluation
        episodes = settings.final_episodes if last else settings.episodes
        return evaluate(policy, self.env, episodes, taken, settings.first_start)

    def _without_failure(self, newest: Evaluation) -> bool:
        """Whether `newest` is the last of so many evaluations in a row without a failure as end training."""
        row = self.problem.evaluation.stop_after
        recent = [*self.evaluations, newest][-row:]
        return 0 < row == len(recent) and all(found.success_deterministic == 1.0 for found in recent)

    def close(self) -> None:
        """Close the environment."""
        self.env.close()
