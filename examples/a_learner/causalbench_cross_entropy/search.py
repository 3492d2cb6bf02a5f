"""Cross-entropy method: keep a Gaussian over the parameters of a policy, try draws from it, fit it to the best.

Each stage has a search of its own over linear policies. A world tries one draw per stage in an episode; its score is
the mean summed reward of the steps that the episode spent in the stage.
"""

from contextlib import closing

import gymnasium as gym
import numpy as np
import torch

from causalbench.learner import Counter, Examiner, ObservationScale, StagedPolicy, Trained, TrainingProblem, stage_plan
from causalbench_cross_entropy import SearchSettings


class StageSearch:
    """The search of one stage: parameters (n_inputs + 1, n_own_actions), the last row added to every input."""

    def __init__(self, actions: np.ndarray, n_inputs: int, settings: SearchSettings, rng: np.random.Generator):
        self.actions, self.settings, self.rng = actions, settings, rng
        self.mean: np.ndarray = np.zeros((n_inputs + 1, len(actions)))
        self.std: np.ndarray = np.full_like(self.mean, settings.start_std)
        self.trials: list[tuple[float, np.ndarray]] = []
        self.generations = 0

    def draw(self) -> np.ndarray:
        """Parameters to try."""
        return self.rng.normal(self.mean, self.std)

    def tell(self, score: float, parameters: np.ndarray) -> None:
        """Note a trial; a full generation moves the search to its best."""
        self.trials.append((score, parameters))
        if len(self.trials) < self.settings.population:
            return
        best = sorted(self.trials, key=lambda trial: -trial[0])
        elite = np.array([tried for _, tried in best[: max(1, round(self.settings.elite_share * len(best)))]])
        self.mean, self.std = elite.mean(0), np.maximum(elite.std(0), self.settings.least_std)
        self.trials, self.generations = [], self.generations + 1

    def actor(self) -> list[torch.Tensor]:
        """The mean as an actor of `StagedPolicy`: weights, biases, log of the standard deviation of its actions."""
        weights = torch.from_numpy(self.mean).float()
        return [weights[:-1].contiguous(), weights[-1].contiguous(), torch.full((len(self.actions),), -2.0)]


class Trial:
    """What one world tries in one episode, and how it does."""

    def __init__(self, searches: list[StageSearch]):
        self.searches, self.parameters = searches, [search.draw() for search in searches]
        self.total, self.steps = np.zeros(len(searches)), np.zeros(len(searches))

    def act(self, inputs: np.ndarray, stage: int, n_actions: int) -> np.ndarray:
        """(n_actions,): those of the stage's own, the others 0."""
        action = np.zeros(n_actions)
        action[self.searches[stage].actions] = (np.append(inputs, 1.0) @ self.parameters[stage]).clip(-1.0, 1.0)
        return action

    def note(self, stage: int, reward: float, over: bool) -> None:
        """Add up a step; at the end of the episode tell the searches of the stages that were visited."""
        self.total[stage] += reward
        self.steps[stage] += 1
        for visited in np.flatnonzero(self.steps) if over else ():
            self.searches[visited].tell(self.total[visited] / self.steps[visited], self.parameters[visited])


class Search:
    """The searches of all stages in worlds that step together."""

    def __init__(self, problem: TrainingProblem, env: gym.vector.VectorEnv):
        task, rng = problem.task, np.random.default_rng(problem.seed)
        self.env, self.n_actions = env, len(task.actions)
        self.scale = ObservationScale.of(env.single_observation_space, task)
        plans = [stage_plan(task, problem.method, problem.graph, stage) for stage in range(1, task.n_stages + 1)]
        self.stages = [StageSearch(plan.actions, self.scale.n_inputs, problem.settings, rng) for plan in plans]
        self.trials = [Trial(self.stages) for _ in range(env.num_envs)]
        self.counter = Counter(task.n_stages, env.num_envs)
        self.obs, _ = env.reset(seed=problem.seed)

    def step(self) -> None:
        """One control step of every world."""
        stages, inputs = self.obs["stage"], self.scale(self.obs).numpy().astype(np.float64)
        actions = [trial.act(x, i, self.n_actions) for trial, x, i in zip(self.trials, inputs, stages, strict=True)]
        self.obs, rewards, terminated, truncated, infos = self.env.step(np.array(actions))
        self.counter.add(infos, over := terminated | truncated)
        for world, stage in enumerate(stages):
            self.trials[world].note(stage, rewards[world], over[world])
        self.trials = [Trial(self.stages) if end else trial for trial, end in zip(self.trials, over, strict=True)]
        self.counter.counts.updates = {i: search.generations for i, search in enumerate(self.stages, 1)}

    def policy(self, seed: int) -> StagedPolicy:
        """The means of all stages; `seed` is for sampled evaluation."""
        actors = [search.actor() for search in self.stages]
        return StagedPolicy(actors, [s.actions for s in self.stages], self.n_actions, self.scale, "gaussian", seed)


def search(problem: TrainingProblem) -> Trained:
    """Train for the problem's environment steps; deterministic in its seed."""
    with closing(problem.vector_env(problem.settings.n_envs)) as env, closing(Examiner(problem)) as examiner:
        counts = (run := Search(problem, env)).counter.counts
        while (before := counts.env_steps) < problem.env_steps and not examiner.settled:
            run.step()
            if examiner.is_due(before, counts.env_steps, f"generation {run.stages[0].generations}"):
                examiner.examine(run.policy(problem.seed), counts)
        return Trained(run.policy(problem.seed), counts)
