"""Algorithm 3 of the paper (Training), off-policy: route each step to its stage's agent, train on new samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from causalbench.core.batch import make_batch
from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.env import Observation, StageTaskEnv
from causalbench.core.learners.causal_gradient import StagePlan, stage_plan
from causalbench.core.learners.counting import Counter
from causalbench.core.learners.evaluate import evaluate
from causalbench.core.learners.methods import Method
from causalbench.core.learners.policy import ObservationScale, StagedPolicy
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.replay import Batch
from causalbench.core.learners.settings import EvaluationSettings, SACSettings
from causalbench.core.learners.staged_sac import SACAgent
from causalbench.core.scene import Scene
from causalbench.core.tasks.task import Task
from causalbench.core.vector_env import StageTaskVectorEnv
from causalbench.errors import InvalidGraphError


class StagedSAC:
    """One `SACAgent` per stage and the routing between them."""

    def __init__(
        self, task: Task, plans: list[StagePlan], scale: ObservationScale, settings: SACSettings, seed: int
    ) -> None:
        self.task, self.plans, self.scale, self.settings = task, plans, scale, settings
        seeds = np.random.SeedSequence(seed).generate_state(len(plans) + 2)
        self.agents = [SACAgent(plan, len(scale.low), settings, int(s)) for plan, s in zip(plans, seeds, strict=False)]
        self.rng = np.random.default_rng(int(seeds[-1]))
        self.policy = StagedPolicy(
            [agent.actor for agent in self.agents],
            [plan.actions for plan in plans],
            len(task.actions),
            scale,
            seed=int(seeds[-2]),
        )

    def act(self, obs: Observation) -> NDArray[np.float64]:
        """Algorithm 3, "select agent u(s_t)": actions (n, n_actions), other dimensions 0.

        An agent whose buffer holds fewer than `learning_starts` samples acts uniformly at random.
        """
        stages, inputs = obs["stage"], self.scale(obs)
        actions = np.zeros((len(stages), len(self.task.actions)))
        for index in set(stages.tolist()):
            rows = np.flatnonzero(stages == index)
            agent, own = self.agents[index], self.plans[index].actions
            if agent.buffer.size < self.settings.learning_starts:
                chosen = self.rng.uniform(-1.0, 1.0, (len(rows), len(own)))
            else:
                chosen = agent.act(inputs[rows], deterministic=False).numpy()
            actions[np.ix_(rows, own)] = chosen
        return actions

    def remember(self, obs: Observation, actions: NDArray[Any], infos: dict[str, Any]) -> None:
        """Store each world's transition with the agent of the stage it began in; leaving the stage ends its episode."""
        inputs, next_inputs = self.scale(obs), self.scale(infos["final_obs"])
        done = (infos["next_stage"] != infos["stage"]) | infos["is_success"]
        for stage in set(infos["stage"].tolist()):
            rows = np.flatnonzero(infos["stage"] == stage)
            plan = self.plans[stage - 1]
            self.agents[stage - 1].buffer.add(
                Batch(
                    inputs[rows],
                    torch.from_numpy(actions[np.ix_(rows, plan.actions)]).float(),
                    torch.from_numpy(infos["vector_reward"][rows] @ plan.reward_groups.T).float(),
                    next_inputs[rows],
                    torch.from_numpy(done[rows]).float(),
                )
            )

    def train(self, cooperation: bool) -> None:
        """Algorithm 3, lines "if the cumulative number of new samples >= count: training pi_i"."""
        starts = self.settings.learning_starts
        for agent, following in zip(self.agents, [*self.agents[1:], None], strict=True):
            if agent.buffer.size < starts:
                agent.buffer.new = 0
            elif agent.buffer.new >= self.settings.train_every:
                steps = int(agent.buffer.new * self.settings.updates_per_sample)
                agent.buffer.new = 0
                # The next critic says nothing about this stage's states until it has seen data of its own.
                ready = cooperation and following is not None and following.buffer.size >= starts
                agent.train(steps, following if ready else None)


def train(
    task: Task,
    make_scene: Callable[[], Scene],
    method: Method,
    graph: CausalGraph | None,
    settings: SACSettings,
    evaluation: EvaluationSettings,
    env_steps: int,
    seed: int,
    on_evaluation: Callable[[Evaluation, TrainingCounts], None],
    on_progress: Callable[[float, str], None],
) -> tuple[StagedPolicy, TrainingCounts]:
    """Train `method` for `env_steps` control steps, all worlds together; deterministic in `seed`.

    `graph` is the discovered one where the method asks for it; the declared and the empty one are found here.
    `on_evaluation` gets an evaluation every `evaluation.every` steps and one at the end.
    Raises `InvalidGraphError` for a missing or wrong graph and `DivergedError` for a loss that is not finite.
    """
    graph = _graph_of(task, method, graph)
    plans = [stage_plan(task, method, graph, stage, settings.critics) for stage in range(1, task.n_stages + 1)]
    env = StageTaskVectorEnv(task, make_batch(make_scene, settings.n_envs), settings.observe_gripper)
    judge_env = StageTaskEnv(task, make_scene(), observe_gripper=settings.observe_gripper)
    try:
        learner = StagedSAC(task, plans, ObservationScale.of(env.single_observation_space), settings, seed)
        counter = Counter(task.n_stages, env.num_envs)
        obs, _ = env.reset(seed=seed)
        next_evaluation = evaluation.every
        while counter.counts.env_steps < env_steps:
            actions = learner.act(obs)
            next_obs, _, terminated, truncated, infos = env.step(actions)
            learner.remember(obs, actions, infos)
            counter.add(infos, terminated | truncated)
            learner.train(method.cooperation)
            obs = next_obs
            taken = counter.counts.env_steps
            on_progress(min(1.0, taken / env_steps), f"stage {int(obs['stage'].max()) + 1}")
            if taken >= next_evaluation or taken >= env_steps:
                next_evaluation += evaluation.every
                final = taken >= env_steps
                episodes = evaluation.final_episodes if final else evaluation.episodes
                counter.counts.updates = {i: agent.updates for i, agent in enumerate(learner.agents, 1)}
                on_evaluation(evaluate(learner.policy, judge_env, episodes, taken), counter.counts)
        return learner.policy, counter.counts
    finally:
        env.close()
        judge_env.close()


def _graph_of(task: Task, method: Method, graph: CausalGraph | None) -> CausalGraph | None:
    if method.matrix == "none":
        return None
    if method.matrix == "manual":
        return manual_graph(task)
    if graph is None:
        raise InvalidGraphError(f"method {method.name!r} needs a discovered causal graph of {task.name}, got none")
    graph.check(task)
    return graph
