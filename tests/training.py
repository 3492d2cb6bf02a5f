"""Training in one call, for tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scenes import worlds_of

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.checkpoint import Checkpoints
from causalbench.core.learners.methods import METHODS, Method
from causalbench.core.learners.registry import LEARNERS, OnEvaluation, OnProgress, Trained, TrainingProblem
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.learners.training_graph import training_graph
from causalbench.core.tasks.task import Task
from causalbench.core.world.scene import Scene

METHOD: dict[str, Method] = {method.name: method for method in METHODS}


def train(
    task: Task,
    make_scene: Callable[[], Scene],
    method: Method,
    graph: CausalGraph | None,
    settings: Any,
    evaluation: EvaluationSettings,
    env_steps: int,
    seed: int = 0,
    on_evaluation: OnEvaluation = lambda evaluation, counts: None,
    on_progress: OnProgress = lambda share, text: None,
    checkpoints: Checkpoints | None = None,
) -> Trained:
    """Train a method of the table by its learner, on the graph that it asks for."""
    make_worlds = worlds_of(task, make_scene)
    graph = training_graph(task, method, graph, make_worlds, seed)
    problem = TrainingProblem(
        task, make_worlds, method, graph, settings, evaluation, env_steps, seed, on_evaluation, on_progress, checkpoints
    )
    return LEARNERS[method.learner].train(problem)
