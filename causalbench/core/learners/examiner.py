"""When a learner is evaluated, and by whom: an examiner with an environment of its own."""

from __future__ import annotations

from causalbench.core.learners.evaluation import evaluate
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.registry import Policy, TrainingProblem


class Examiner:
    """Tells how far a training run is and evaluates its policy whenever that is due; close it at the end."""

    def __init__(self, problem: TrainingProblem) -> None:
        self.problem, self.env = problem, problem.env()
        self.evaluations: list[Evaluation] = []
        """All evaluations so far."""

    def is_due(self, before: int, taken: int, doing: str) -> bool:
        """Report the env steps `taken` and say whether those since `before` make an evaluation due.

        The steps that reach the budget do. `doing` is a few words for people.
        """
        problem = self.problem
        problem.on_progress(min(1.0, taken / problem.env_steps), doing)
        return problem.evaluation.episodes_due(before, taken, problem.env_steps) > 0

    def examine(self, policy: Policy, counts: TrainingCounts) -> Evaluation:
        """Evaluate `policy` after the steps in `counts`, and hand both on; the last time with more episodes."""
        taken, settings = counts.env_steps, self.problem.evaluation
        episodes = settings.final_episodes if taken >= self.problem.env_steps else settings.episodes
        self.evaluations.append(evaluate(policy, self.env, episodes, taken))
        self.problem.on_evaluation(self.evaluations[-1], counts)
        return self.evaluations[-1]

    def close(self) -> None:
        """Close the environment."""
        self.env.close()
