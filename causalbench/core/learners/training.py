"""Algorithm 3 of the paper (Training): the loop that every staged learner runs in."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import torch

from causalbench._version import __version__
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.checkpoint import REMEDY, Checkpoints, load_checkpoint, save_checkpoint
from causalbench.core.learners.counting import Counter
from causalbench.core.learners.examiner import Examiner
from causalbench.core.learners.learner import StagedLearner
from causalbench.core.learners.methods import Method
from causalbench.core.learners.policy import ObservationScale
from causalbench.core.learners.registry import Trained, TrainingProblem
from causalbench.core.learners.scalars import FirstEntry
from causalbench.core.networks.state import State, below, prefixed
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.tasks.task_data import task_data
from causalbench.core.world.capabilities import Capability
from causalbench.errors import CheckpointError, DivergedError, StoppedError

LOG = logging.getLogger(__name__)

MakeStagedLearner = Callable[[StageTask, Method, CausalGraph | None, ObservationScale, Any, int], StagedLearner]
"""(task, method, graph, scale of the observations, settings, seed) to a learner."""


def train_staged(problem: TrainingProblem, make_learner: MakeStagedLearner) -> Trained:
    """Train the agents of all stages in `settings.n_envs` worlds that step together; deterministic in the seed.

    The settings inherit `StagedSettings`. A budget that is no multiple of `n_envs` is rounded up to one; the counts
    have the steps taken.

    With `problem.checkpoints`, a call that was killed goes on from its last checkpoint when it is repeated, and ends
    with the same bits as an uninterrupted one; `on_evaluation` first gets the evaluations made before. The last
    checkpoint is of the budget's end; a call with a larger `env_steps` goes on there, also to the same bits. A backend
    that lacks `EXACT_RESTORE` starts again instead.

    Raises `CheckpointError` for a checkpoint that is not this run's, and `DivergedError` for a loss that explodes or is
    not finite, and `StoppedError` when `problem.checkpoints` says that it should stop.
    """
    with closing(problem.vector_env(problem.settings.n_envs)) as env, closing(Examiner(problem)) as examiner:
        loop = _StagedLoop(problem, make_learner, env, examiner)
        loop.go_on()
        while not loop.over:
            loop.step()
        loop.name_unreached()
        return Trained(loop.learner.policy, loop.counter.counts)


class _StagedLoop:
    """One training run: the learner, its worlds, and what has been counted."""

    def __init__(
        self, problem: TrainingProblem, make_learner: MakeStagedLearner, env: StageTaskVectorEnv, examiner: Examiner
    ) -> None:
        task, settings = problem.task, problem.settings
        self.problem, self.env, self.examiner = problem, env, examiner
        scale = ObservationScale.of(env.single_observation_space, task, settings.observation)
        self.learner = make_learner(task, problem.method, problem.graph, scale, settings, problem.seed)
        self.counter = Counter(task.n_stages, env.num_envs)
        self.first_entry = FirstEntry(task, env.num_envs) if settings.bonus == "first_entry" else None
        self.obs, _ = env.reset(seed=problem.seed)
        self.checkpoints = _usable(problem.checkpoints, env)
        self.saved = 0  # env steps of the last checkpoint

    @property
    def taken(self) -> int:
        """Env steps so far."""
        return self.counter.counts.env_steps

    @property
    def over(self) -> bool:
        """Whether training has ended."""
        return self.examiner.settled or self.taken >= self.problem.env_steps

    def step(self) -> None:
        """Act, remember, train, and keep a checkpoint and evaluate if that is due.

        A checkpoint comes first, since the last evaluation, with more episodes, is that of one budget only.
        """
        before, obs = self.taken, self.obs
        actions = self.learner.act(obs)
        self.obs, _, terminated, truncated, infos = self.env.step(actions.clip(-1.0, 1.0))
        over = terminated | truncated
        paid = {"vector_reward": self.first_entry(infos, over)} if self.first_entry else {}
        self.learner.remember(obs, actions, infos | paid, over)
        self.counter.add(infos, over)
        self._train()
        if self.checkpoints:
            self._keep(self.checkpoints, before)
        self._examine(before)

    def _examine(self, before: int) -> None:
        """Evaluate if that is due since the env step `before`."""
        if self.examiner.is_due(before, self.taken, f"stage {int(self.obs['stage'].max()) + 1}"):
            self.counter.counts.updates = self.learner.updates()
            self.examiner.examine(self.learner.policy, self.counter.counts)

    def _train(self) -> None:
        """Let the learner train. Raises `DivergedError` with the step and the last good checkpoint."""
        try:
            self.learner.train()
        except DivergedError as error:
            path = self.checkpoints.path if self.checkpoints else ""
            kept = f"; last good checkpoint, of step {self.saved}: {path}" if self.saved else ""
            raise DivergedError(f"env step {self.taken}, {error}{kept}") from error

    def name_unreached(self) -> None:
        """Log the stages that no episode reached."""
        unreached = [stage for stage, episodes in self.counter.counts.reached.items() if not episodes]
        if unreached:
            LOG.info("never reached, so not trained: stages %s", unreached)

    def go_on(self) -> None:
        """Continue from the checkpoint, if there is one: report its evaluations again, make the one that follows."""
        if not self.checkpoints or not (state := load_checkpoint(self.checkpoints.path, self._identity())):
            return
        self.obs = self.env.load_state(below("env", state))
        self.learner.load_state(below("learner", state))
        self.counter.load_state(below("counter", state))
        if self.first_entry:
            self.first_entry.reached = np.asarray(state["reached"])
        self.saved = self.taken
        self._check_within_budget(self.checkpoints.path)
        LOG.info("continued from the checkpoint at step %d", self.taken)
        self.examiner.load_state(below("examiner", state))
        for evaluation in self.examiner.evaluations:
            self.problem.on_evaluation(evaluation, self.counter.counts)
        self._examine(self.taken - self.env.num_envs)

    def _check_within_budget(self, path: Path) -> None:
        """Raise `CheckpointError` for a checkpoint that is of a later step than the budget's last."""
        if self.taken - self.env.num_envs >= self.problem.env_steps:
            beyond = f"a checkpoint of env step {self.taken}, beyond the budget of {self.problem.env_steps}"
            raise CheckpointError(f"{path}: {beyond}; {REMEDY}")

    def _keep(self, checkpoints: Checkpoints, before: int) -> None:
        """Keep a checkpoint if it is due. Raises `StoppedError` after one if that was asked for."""
        stopped = checkpoints.stop_asked()
        due = self.taken // checkpoints.every > before // checkpoints.every
        if stopped or due or self.taken >= self.problem.env_steps:
            self._save(checkpoints)
        if stopped:
            raise StoppedError(f"stopped at env step {self.taken}; its checkpoint is {checkpoints.path}")

    def _save(self, checkpoints: Checkpoints) -> None:
        state: State = prefixed("env", self.env.state()) | prefixed("learner", self.learner.state())
        state |= prefixed("counter", self.counter.state())
        if self.first_entry:
            state["reached"] = self.first_entry.reached
        state |= prefixed("examiner", self.examiner.state())
        save_checkpoint(checkpoints.path, state, self._identity())
        self.saved = self.taken

    def _identity(self) -> dict[str, Any]:
        """What two runs must share for one to continue the other, bit for bit, as JSON data: all but the budget."""
        problem, task = self.problem, self.problem.task
        return {
            "task": {"name": task.name, "version": task.version, "data": task_data(task)},
            "worlds": dict(self.env.worlds.identity),
            "method": dataclasses.asdict(problem.method),
            "graph": problem.graph.hash if problem.graph else None,
            "settings": dataclasses.asdict(problem.settings),
            "evaluation": dataclasses.asdict(problem.evaluation),
            "seed": problem.seed,
            "versions": {"causalbench": __version__, "numpy": np.__version__, "torch": torch.__version__},
        }


def _usable(checkpoints: Checkpoints | None, env: StageTaskVectorEnv) -> Checkpoints | None:
    """None where the backend cannot go on with the same bits."""
    if checkpoints and Capability.EXACT_RESTORE not in env.worlds.capabilities:
        LOG.info("backend %s does not restore exactly: no checkpoints are kept", env.worlds.origin.backend)
        return None
    return checkpoints
