"""Discovery and training from Python, on an environment of `make_env`: `causalbench.discover`, `causalbench.train`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from causalbench.core.discovery import pipeline
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners import training
from causalbench.core.learners.checkpoint import Checkpoints
from causalbench.core.learners.policy import StagedPolicy
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.settings import PRESETS, EvaluationSettings, LearnerSettings
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.tasks.task import Task
from causalbench.core.world.scene import Scene
from causalbench.errors import UserError
from causalbench.plugins.manager import installed


class Trained(NamedTuple):
    """What `train` returns."""

    policy: StagedPolicy
    evaluations: list[Evaluation]
    counts: TrainingCounts


def _silent(share: float, text: str) -> None:
    """Report nothing."""


def discover(
    env: gym.Env[Any, Any],
    settings: DiscoverySettings = DiscoverySettings(),  # noqa: B008 - frozen
    seed: int = 0,
    on_progress: Callable[[float, str], None] = _silent,
) -> CausalGraph:
    """The causal graph of `env`'s task (paper, Algorithm 1), found in scenes of its own like that of `env`.

    `on_progress(share done, what is being done)` is called often. Raises `UserError` unless `make_env` made `env`.
    """
    task, make_scene, _ = _parts(env)
    return pipeline.discover(task, make_scene, settings, seed, on_progress, discoverers=installed().discoverers)


def train(
    env: gym.Env[Any, Any],
    method: str = "cmSAC",
    graph: CausalGraph | None = None,
    env_steps: int = 20_000,
    seed: int = 0,
    settings: LearnerSettings | None = None,
    evaluation: EvaluationSettings = EvaluationSettings(),  # noqa: B008 - frozen
    checkpoint: Path | str | None = None,
    on_progress: Callable[[float, str], None] = _silent,
) -> Trained:
    """Train `method` on `env`'s task, in scenes of its own like that of `env` (paper, Algorithm 3).

    `graph` is what a method with a discovered matrix needs; `settings` are the quick tier's if None; the policy
    observes what `env` does. With the file `checkpoint`, a call that was killed goes on there when it is repeated.
    Raises as `core.learners.training.train`, and `UserError` unless `make_env` made `env`.
    """
    task, make_scene, observed = _parts(env)
    chosen = installed().method(method)
    settings = settings or PRESETS[chosen.learner]["quick"]
    evaluations: list[Evaluation] = []
    policy, counts = training.train(
        task,
        make_scene,
        chosen,
        graph,
        dataclasses.replace(settings, **observed),
        evaluation,
        env_steps,
        seed,
        lambda done, _: evaluations.append(done),
        on_progress,
        Checkpoints(Path(checkpoint)) if checkpoint else None,
    )
    return Trained(policy, evaluations, counts)


def _parts(env: gym.Env[Any, Any]) -> tuple[Task, Callable[[], Scene], dict[str, Any]]:
    inner = env.unwrapped
    if not isinstance(inner, StageTaskEnv) or inner.make_scene is None:
        raise UserError(f"{env}: expected an environment from causalbench.make_env or gymnasium.make")
    return inner.task, inner.make_scene, {"observe_gripper": inner.observe_gripper, "observation": inner.observe}
