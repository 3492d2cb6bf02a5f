"""The learner CEM, a search without gradients, and a method that gives each stage the actions a human calls causal."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le

from causalbench.learner import Learner, Trained, TrainingProblem
from causalbench.method import Method, hookimpl


@dataclass(frozen=True)
class SearchSettings:
    """In a suite: `learner: {CEM: {population: 32}}`."""

    population: Annotated[int, Gt(1)] = 24  # trials of one stage that make a generation
    elite_share: Annotated[float, Gt(0), Le(1)] = 0.25
    start_std: Annotated[float, Gt(0)] = 0.5  # of every parameter in the first generation
    least_std: Annotated[float, Gt(0)] = 0.02
    n_envs: Annotated[int, Gt(0)] = 4


def train(problem: TrainingProblem) -> Trained:
    """Search; torch is imported now, not when learners are listed."""
    from causalbench_cross_entropy.search import search

    return search(problem)


@hookimpl
def causalbench_learners(register: Callable[[Learner], None]) -> None:
    """Add the algorithm to those that methods can name."""
    register(Learner("CEM", SearchSettings, train, about="cross-entropy search of a linear policy per stage"))


@hookimpl
def causalbench_methods(register: Callable[[Method], None]) -> None:
    """Add methods: on the causal actions as a human names them, and on all actions."""
    register(Method("cmmCEM", "CEM", "causal", "scalar", "manual"))
    register(Method("mCEM", "CEM", "full", "scalar", "none"))
