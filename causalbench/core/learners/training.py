"""Algorithm 3 of the paper (Training): the loop that every learner runs in."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch

from causalbench._version import __version__
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.checkpoint import Checkpoints, load_checkpoint, save_checkpoint
from causalbench.core.learners.counting import Counter
from causalbench.core.learners.evaluation import evaluate
from causalbench.core.learners.learner import StagedLearner
from causalbench.core.learners.methods import Method
from causalbench.core.learners.policy import ObservationScale, StagedPolicy
from causalbench.core.learners.ppo.staged import StagedPPO
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.sac.staged import StagedSAC
from causalbench.core.learners.settings import PRESETS, EvaluationSettings, LearnerSettings
from causalbench.core.learners.training_graph import training_graph
from causalbench.core.networks.state import below, prefixed
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import make_batch
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import DivergedError, UserError

LOG = logging.getLogger(__name__)

LEARNERS: Mapping[str, Callable[..., StagedLearner]] = {"SAC": StagedSAC, "PPO": StagedPPO}
"""What a row of the method table calls its `learner`, made from (task, method, graph, scale, settings, seed)."""


def train(
    task: Task,
    make_scene: Callable[[], Scene],
    method: Method,
    graph: CausalGraph | None,
    settings: LearnerSettings,
    evaluation: EvaluationSettings,
    env_steps: int,
    seed: int,
    on_evaluation: Callable[[Evaluation, TrainingCounts], None],
    on_progress: Callable[[float, str], None],
    checkpoints: Checkpoints | None = None,
) -> tuple[StagedPolicy, TrainingCounts]:
    """Train `method` for `env_steps` control steps, all worlds together; deterministic in `seed`.

    Worlds step together, so a budget that is no multiple of `settings.n_envs` is rounded up to one; the counts have
    the steps taken. `graph` is the discovered one where the method asks for it; the declared and the empty one are
    found here. `on_evaluation` gets an evaluation every `evaluation.every` steps and one at the end.

    With `checkpoints`, a call that was killed goes on from its last checkpoint when it is repeated, and ends with the
    same bits as an uninterrupted one; `on_evaluation` first gets the evaluations made before. A backend that lacks
    `EXACT_RESTORE` starts again instead.

    Raises `InvalidGraphError` for a missing or wrong graph, `CheckpointError` for a checkpoint that is not this
    run's, `UserError` for settings of another learner, and `DivergedError` for a loss that explodes or is not finite.
    """
    expected = type(PRESETS[method.learner]["quick"])
    if not isinstance(settings, expected):
        raise UserError(f"method {method.name!r} takes {expected.__name__}, got {type(settings).__name__}")
    graph = training_graph(task, method, graph, make_scene, seed)
    if method.stock and settings.observation == "paper":
        raise UserError(f"method {method.name!r} reads the state alone: it cannot have `observation: paper`")
    gripper, observe = settings.observe_gripper, settings.observation
    env = StageTaskVectorEnv(task, make_batch(make_scene, settings.n_envs), gripper, observe)
    judge_env = StageTaskEnv(task, make_scene(), observe_gripper=gripper, observe=observe)
    try:
        if method.stock:
            from causalbench.core.learners.sb3.stock import train_stock  # SB3 takes a second to import

            if checkpoints:
                LOG.info("stable-baselines3's own agents keep no checkpoints")
            return train_stock(env, judge_env, settings, evaluation, env_steps, seed, on_evaluation, on_progress)
        scale = ObservationScale.of(env.single_observation_space, task.sensor_in(settings.observation))
        learner = LEARNERS[method.learner](task, method, graph, scale, settings, seed)
        counter = Counter(task.n_stages, env.num_envs)
        obs, _ = env.reset(seed=seed)
        history: list[Evaluation] = []
        if checkpoints and Capability.EXACT_RESTORE not in env.batch.spec.capabilities:
            LOG.info("backend %s does not restore exactly: no checkpoints are kept", env.batch.spec.backend)
            checkpoints = None
        if checkpoints:
            identity = _identity(task, env.batch.spec, method, graph, settings, evaluation, env_steps, seed)
            if state := load_checkpoint(checkpoints.path, identity):
                obs = env.load_state(below("env", state))
                learner.load_state(below("learner", state))
                counter.load_state(below("counter", state))
                history = [Evaluation(**record) for record in state["evaluations"]]
                LOG.info("continued from the checkpoint at step %d", counter.counts.env_steps)
                for earlier in history:
                    on_evaluation(earlier, counter.counts)
        saved = counter.counts.env_steps  # of the last checkpoint
        while counter.counts.env_steps < env_steps:
            before = counter.counts.env_steps
            actions = learner.act(obs)
            obs_before, (obs, _, terminated, truncated, infos) = obs, env.step(actions.clip(-1.0, 1.0))
            over = terminated | truncated
            learner.remember(obs_before, actions, infos, over)
            counter.add(infos, over)
            taken = counter.counts.env_steps
            try:
                learner.train()
            except DivergedError as error:
                kept = f"; last good checkpoint, of step {saved}: {checkpoints.path}" if checkpoints and saved else ""
                raise DivergedError(f"env step {taken}, {error}{kept}") from error
            on_progress(min(1.0, taken / env_steps), f"stage {int(obs['stage'].max()) + 1}")
            if episodes := evaluation.episodes_due(before, taken, env_steps):
                counter.counts.updates = learner.updates()
                history.append(evaluate(learner.policy, judge_env, episodes, taken))
                on_evaluation(history[-1], counter.counts)
            if checkpoints and taken < env_steps and taken // checkpoints.every > before // checkpoints.every:
                state = prefixed("env", env.state()) | prefixed("learner", learner.state())
                state |= prefixed("counter", counter.state())
                state["evaluations"] = [dataclasses.asdict(record) for record in history]
                save_checkpoint(checkpoints.path, state, identity)
                saved = taken
        unreached = [stage for stage, episodes in counter.counts.reached.items() if not episodes]
        if unreached:
            LOG.info("never reached, so not trained: stages %s", unreached)
        return learner.policy, counter.counts
    finally:
        env.close()
        judge_env.close()


def _identity(
    task: Task, spec: SceneSpec, method: Method, graph: CausalGraph | None, settings: LearnerSettings,
    evaluation: EvaluationSettings, env_steps: int, seed: int,
) -> dict[str, Any]:  # fmt: skip
    """What two runs must share for one to continue the other, bit for bit, as JSON data."""
    return {
        "task": {"name": task.name, "version": task.version, "constants": dict(task.constants)},
        "backend": dataclasses.asdict(spec) | {"capabilities": sorted(spec.capabilities)},
        "method": dataclasses.asdict(method),
        "graph": graph.hash if graph else None,
        "settings": dataclasses.asdict(settings),
        "evaluation": dataclasses.asdict(evaluation),
        "env_steps": env_steps,
        "seed": seed,
        "versions": {"causalbench": __version__, "numpy": np.__version__, "torch": torch.__version__},
    }
