"""Algorithm 3 of the paper (Training): the loop that every learner runs in."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from causalbench.core.batch import make_batch
from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.env import StageTaskEnv
from causalbench.core.learners.counting import Counter
from causalbench.core.learners.evaluate import evaluate
from causalbench.core.learners.learner import StagedLearner
from causalbench.core.learners.methods import Method
from causalbench.core.learners.policy import ObservationScale, StagedPolicy
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.settings import EvaluationSettings, SACSettings
from causalbench.core.learners.staged_sac import StagedSAC
from causalbench.core.scene import Scene
from causalbench.core.tasks.task import Task
from causalbench.core.vector_env import StageTaskVectorEnv
from causalbench.errors import InvalidGraphError

LEARNERS: Mapping[str, Callable[..., StagedLearner]] = {"SAC": StagedSAC}
"""What a row of the method table calls its `learner`, made from (task, method, graph, scale, settings, seed)."""


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
    env = StageTaskVectorEnv(task, make_batch(make_scene, settings.n_envs), settings.observe_gripper)
    judge_env = StageTaskEnv(task, make_scene(), observe_gripper=settings.observe_gripper)
    try:
        scale = ObservationScale.of(env.single_observation_space)
        learner = LEARNERS[method.learner](task, method, graph, scale, settings, seed)
        counter = Counter(task.n_stages, env.num_envs)
        obs, _ = env.reset(seed=seed)
        next_evaluation = evaluation.every
        while counter.counts.env_steps < env_steps:
            actions = learner.act(obs)
            next_obs, _, terminated, truncated, infos = env.step(actions)
            over = terminated | truncated
            learner.remember(obs, actions, infos, over)
            counter.add(infos, over)
            learner.train()
            obs = next_obs
            taken = counter.counts.env_steps
            on_progress(min(1.0, taken / env_steps), f"stage {int(obs['stage'].max()) + 1}")
            if taken >= next_evaluation or taken >= env_steps:
                next_evaluation += evaluation.every
                final = taken >= env_steps
                episodes = evaluation.final_episodes if final else evaluation.episodes
                counter.counts.updates = learner.updates()
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
