"""Proximal policy optimisation of all stages: one `PPOAgent` each, and the routing (paper, Algorithm 3)."""

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
from causalbench.core.learners.ppo.agent import PPOAgent
from causalbench.core.learners.ppo.rollout import Rollout, Steps
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.networks.state import State, below, prefixed
from causalbench.core.staged.observation import Observation
from causalbench.core.tasks.stage_task import StageTask


class StagedPPO:
    """See `StagedLearner`. On-policy: all agents train at the end of an epoch of `n_steps` control steps."""

    def __init__(
        self,
        task: StageTask,
        method: Method,
        graph: CausalGraph | None,
        scale: ObservationScale,
        settings: PPOSettings,
        seed: int,
    ) -> None:
        self.task, self.scale = task, scale
        self.plans = stage_plans(task, method, graph, settings.critics, settings.full_stages)
        seeds = np.random.SeedSequence(seed).generate_state(task.n_stages + 1)
        n_obs, n_actions = scale.n_inputs, len(task.actions)
        self.agents = [
            PPOAgent(plan, n_obs, settings, int(s), scale.sensor) for plan, s in zip(self.plans, seeds, strict=False)
        ]
        n_steps = max(1, settings.n_steps // settings.n_envs)
        self.rollout = Rollout(n_steps, settings.n_envs, n_obs, n_actions, len(task.terms))
        self.settings, self.epochs = settings, 0
        self.policy = StagedPolicy(
            [agent.policy_weights for agent in self.agents],
            [plan.actions for plan in self.plans],
            n_actions,
            scale,
            "gaussian",
            seed=int(seeds[-1]),
        )

    def act(self, obs: Observation) -> NDArray[np.float64]:
        """Algorithm 3, "select agent u(s_t)": actions (n, n_actions), not clipped to their bounds; the others are 0."""
        stages, inputs = obs["stage"], self.scale(obs)
        actions = np.zeros((len(stages), len(self.task.actions)))
        for index in set(stages.tolist()):
            rows = np.flatnonzero(stages == index)
            actions[np.ix_(rows, self.plans[index].actions)] = self.agents[index].act(inputs[rows]).numpy()
        return actions

    def remember(
        self, obs: Observation, actions: NDArray[Any], infos: Mapping[str, Any], over: NDArray[np.bool_]
    ) -> None:
        """Algorithm 3, "collecting state, action, and reward data"; leaving the stage ends its agent's episode."""
        done = (infos["next_stage"] != infos["stage"]) | infos["terminated"]
        self.rollout.add(
            Steps(
                self.scale(obs),
                torch.from_numpy(actions).float(),
                torch.from_numpy(infos["vector_reward"]).float(),
                self.scale(infos["final_obs"]),
                torch.from_numpy(infos["stage"]),
                torch.from_numpy(done),
                torch.from_numpy(over),
            )
        )

    def train(self) -> None:
        """Algorithm 3, at the end of an epoch: "for i from 1 to N: training pi_i with causal policy gradient ..."."""
        if not self.rollout.full:
            return
        for stage, agent in enumerate(self.agents, 1):
            agent.collect(self.rollout.steps, stage)
            agent.set_learning_rate(self._learning_rate())
            with diverging_in(stage):
                agent.train()
        self.rollout.length = 0
        self.epochs += 1

    def _learning_rate(self) -> float:
        """Of the epoch that has been collected: at its full in the first, at 0 once `decay_steps` have been taken."""
        rate, decay_steps = self.settings.learning_rate, self.settings.decay_steps
        taken = self.epochs * self.rollout.steps.stage.numel()
        return rate * max(0.0, 1.0 - taken / decay_steps) if decay_steps else rate

    def updates(self) -> dict[int, int]:
        """Stage -> gradient updates so far."""
        return {stage: agent.updates for stage, agent in enumerate(self.agents, 1)}

    def state(self) -> State:
        """The agents', the unfinished epoch, and the policy's generator."""
        own: State = {"policy_generator": self.policy.generator.get_state(), "epochs": self.epochs}
        own |= prefixed("rollout", self.rollout.state())
        for stage, agent in enumerate(self.agents, 1):
            own |= prefixed(f"stage{stage}", agent.state())
        return own

    def load_state(self, state: State) -> None:
        """Go on from `state`."""
        self.policy.generator.set_state(state["policy_generator"])
        self.epochs = state["epochs"]
        self.rollout.load_state(below("rollout", state))
        for stage, agent in enumerate(self.agents, 1):
            agent.load_state(below(f"stage{stage}", state))
