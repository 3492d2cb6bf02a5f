"""Discovery and training from Python: `causalbench.discover`, `causalbench.train`, `causalbench.load_graph`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from causalbench.arguments import Seed, Steps, check_argument, check_record
from causalbench.core.discovery import pipeline
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners.checkpoint import Checkpoints
from causalbench.core.learners.methods import Method
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.registry import Learner, Policy, TrainingProblem
from causalbench.core.learners.settings import EvaluationSettings, observed
from causalbench.core.learners.training_graph import training_graph
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.worlds import MakeWorlds
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import InvalidGraphError, UserError
from causalbench.plugins.manager import installed


class TrainingRun(NamedTuple):
    """What `train` returns: the policy after the last step, all evaluations in order, and the counts of training."""

    policy: Policy
    evaluations: list[Evaluation]
    counts: TrainingCounts


def _silent(share: float, text: str) -> None:
    """Report nothing."""


def load_graph(path: str | PathLike[str]) -> CausalGraph:
    """Read the causal graph in a file `graph.json`, which `causalbench discover` and `CausalGraph.to_json` write.

    Raises `InvalidGraphError` for a file that cannot be read, is no graph, or does not match its own hash.
    """
    return CausalGraph.load(Path(path))


def discover(
    env: gym.Env[Any, Any],
    settings: DiscoverySettings = DiscoverySettings(),  # noqa: B008 - frozen
    seed: int = 0,
    on_progress: Callable[[float, str], None] = _silent,
) -> CausalGraph:
    """Discover the causal graph of the task of `env` (paper, Algorithm 1) and return it.

    `env` is an environment from `make_env` or `gymnasium.make`, without further wrappers. It is not stepped: discovery
    makes new worlds of the same task and backend. `settings` say which discoverer is used and how many samples it gets.
    The same `seed` gives the same graph. `on_progress(share, text)` is called often, with the share done in [0, 1] and
    a few words.

    Raises `UserError` for another environment, for a wrapper, and for a setting or a seed out of its bounds.
    """
    task, make_worlds, _ = _parts(env)
    check_record(settings, DiscoverySettings)
    check_argument("seed", seed, Seed)
    return pipeline.discover(task, make_worlds, settings, seed, on_progress, discoverers=installed().discoverers)


def train(
    env: gym.Env[Any, Any],
    method: str = "cmSAC",
    graph: CausalGraph | None = None,
    env_steps: int = 20_000,
    seed: int = 0,
    settings: Any = None,
    evaluation: EvaluationSettings = EvaluationSettings(),  # noqa: B008 - frozen
    checkpoint: Path | str | None = None,
    on_progress: Callable[[float, str], None] = _silent,
) -> TrainingRun:
    """Train `method` on the task of `env` (paper, Algorithm 3) and return the policy, its evaluations and counts.

    - `env` is an environment from `make_env` or `gymnasium.make`, without further wrappers. It is not stepped: training
      makes new worlds of the same task and backend. The policy observes what `env` observes.
    - `graph` is the causal graph of a method with a discovered matrix; other methods take None.
    - `env_steps` is the budget in control steps of all worlds together.
    - `settings` is a record of the method's learner, such as `SACSettings`; None stands for its defaults.
    - `evaluation` says when and how the policy is evaluated.
    - `checkpoint` is a file. If a call was killed, the same call continues from this file.
    - `on_progress(share, text)` is called often, with the share done in [0, 1] and a few words.

    Raises `InvalidGraphError` for a missing or wrong graph and for one that the method would not use, `CheckpointError`
    for a checkpoint of another run, `DivergedError` for a loss that explodes, and `UserError` for another environment,
    for a wrapper, for the settings of another learner, and for a value out of its bounds.
    """
    task, make_worlds, seen = _parts(env)
    chosen = installed().method(method)
    check_argument("env_steps", env_steps, Steps)
    check_argument("seed", seed, Seed)
    check_record(evaluation, EvaluationSettings)
    _check_graph(chosen, graph)
    learner = installed().learner(chosen.learner)
    evaluations: list[Evaluation] = []
    problem = TrainingProblem(
        task=task,
        make_worlds=make_worlds,
        method=chosen,
        graph=training_graph(task, chosen, graph, make_worlds, seed),
        settings=_observing(learner, settings or learner.settings(), seen),
        evaluation=evaluation,
        env_steps=env_steps,
        seed=seed,
        on_evaluation=lambda done, _: evaluations.append(done),
        on_progress=on_progress,
        checkpoints=Checkpoints(Path(checkpoint)) if checkpoint else None,
    )
    policy, counts = learner.train(problem)
    return TrainingRun(policy, evaluations, counts)


def _check_graph(method: Method, graph: object) -> None:
    """Raise `InvalidGraphError` for what is no graph, or one that `method` would not look at."""
    if graph is None:
        return
    if not isinstance(graph, CausalGraph):
        raise InvalidGraphError(
            f"graph: expected what causalbench.discover or causalbench.load_graph returns, got {type(graph).__name__}"
        )
    if method.matrix != "discovered":
        uses = {"none": "none", "manual": "the one that a human named", "oracle": "an oracle's"}[method.matrix]
        raise InvalidGraphError(
            f"graph: method {method.name!r} uses {uses}, and this one would be ignored; leave it out"
        )


def _observing(learner: Learner, settings: Any, seen: Mapping[str, Any]) -> Any:
    """`settings` with which a policy observes what is in `seen`. Raises `UserError` where that cannot be."""
    expected: type[Any] = learner.settings
    if not isinstance(settings, expected):
        raise UserError(f"learner {learner.name!r} takes {expected.__name__}, got {type(settings).__name__}")
    check_record(settings, expected)
    given: dict[str, Any] = dataclasses.asdict(settings)
    differing = {key: value for key, value in seen.items() if value != observed(given)[key]}
    for key in differing.keys() - given.keys():
        raise UserError(f"learner {learner.name!r} has no setting {key!r}, and `env` was made with {differing[key]!r}")
    return dataclasses.replace(settings, **differing)


TRANSPARENT = (gym.wrappers.OrderEnforcing, gym.wrappers.PassiveEnvChecker)
"""What `gymnasium.make` puts around every environment, and what changes nothing that a learner sees."""


def _check_wrappers(env: gym.Env[Any, Any]) -> None:
    """Raise `UserError` for a wrapper that training in other worlds would ignore."""
    while isinstance(env, gym.Wrapper):
        if not isinstance(env, TRANSPARENT):
            raise UserError(
                f"{type(env).__name__}: the worlds of train and discover are made anew and would not have this "
                "wrapper; give the environment without it"
            )
        env = env.env


def _parts(env: gym.Env[Any, Any]) -> tuple[StageTask, MakeWorlds, dict[str, Any]]:
    inner = env.unwrapped
    if not isinstance(inner, StageTaskEnv) or inner.make_worlds is None:
        raise UserError(f"{env}: expected an environment from causalbench.make_env or gymnasium.make")
    _check_wrappers(env)
    seen = {"observe_gripper": inner.observe_gripper, "observation": inner.observe, "features": inner.features}
    return inner.task, inner.make_worlds, seen
