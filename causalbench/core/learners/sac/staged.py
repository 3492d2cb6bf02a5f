"""Soft actor-critic of all stages: one `SACAgent` each, and the routing between them (paper, Algorithm 3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.causal_gradient import stage_plans
from causalbench.core.learners.learner import diverging_in
from causalbench.core.learners.methods import Method
from causalbench.core.learners.policy import ObservationScale, StagedPolicy
from causalbench.core.learners.sac.agent import SACAgent
from causalbench.core.learners.sac.buffer import Batch
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.networks.state import State, below, prefixed
from causalbench.core.staged.observation import Observation
from causalbench.core.tasks.stage_task import StageTask


class StagedSAC:
    """See `StagedLearner`. Off-policy: an agent trains once its buffer holds enough new samples."""

    def __init__(
        self,
        task: StageTask,
        method: Method,
        graph: CausalGraph | None,
        scale: ObservationScale,
        settings: SACSettings,
        seed: int,
    ) -> None:
        self.task, self.method, self.scale, self.settings = task, method, scale, settings
        self.plans = stage_plans(task, method, graph, settings.critics, settings.full_stages)
        seeds = np.random.SeedSequence(seed).generate_state(task.n_stages + 2)
        self.agents = [
            SACAgent(plan, scale.n_inputs, settings, int(s), scale.sensor)
            for plan, s in zip(self.plans, seeds, strict=False)
        ]
        self.rng = np.random.default_rng(int(seeds[-1]))
        self.policy = StagedPolicy(
            [agent.policy_weights for agent in self.agents],
            [plan.actions for plan in self.plans],
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

    def remember(
        self, obs: Observation, actions: NDArray[Any], infos: Mapping[str, Any], over: NDArray[np.bool_]
    ) -> None:
        """Store each world's transition with the agent of the stage it began in; leaving the stage ends its episode.

        `over` does not matter: time limits bootstrap.
        """
        inputs, next_inputs = self.scale(obs), self.scale(infos["final_obs"])
        done = (infos["next_stage"] != infos["stage"]) | infos["terminated"]
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

    def train(self) -> None:
        """Algorithm 3, lines "if the cumulative number of new samples >= count: training pi_i"."""
        starts = self.settings.learning_starts
        for stage, (agent, following) in enumerate(zip(self.agents, [*self.agents[1:], None], strict=True), 1):
            if agent.buffer.size < starts:
                agent.buffer.new = 0
            elif agent.buffer.new >= self.settings.train_every:
                steps = int(agent.buffer.new * self.settings.updates_per_sample)
                agent.buffer.new = 0
                # The next critic says nothing about this stage's states until it has seen data of its own.
                ready = self.method.cooperation and following is not None and following.buffer.size >= starts
                with diverging_in(stage):
                    agent.train(steps, following if ready else None)

    def updates(self) -> dict[int, int]:
        """Stage -> gradient updates so far."""
        return {stage: agent.updates for stage, agent in enumerate(self.agents, 1)}

    def state(self) -> State:
        """The agents', and the generators of random starts and of the policy."""
        own: State = {"rng": self.rng.bit_generator.state, "policy_generator": self.policy.generator.get_state()}
        for stage, agent in enumerate(self.agents, 1):
            own |= prefixed(f"stage{stage}", agent.state())
        return own

    def load_state(self, state: State) -> None:
        """Go on from `state`."""
        self.rng.bit_generator.state = state["rng"]
        self.policy.generator.set_state(state["policy_generator"])
        for stage, agent in enumerate(self.agents, 1):
            agent.load_state(below(f"stage{stage}", state))
