"""When and how learners are evaluated, and the presets of each learner by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from causalbench.core.learners.ppo import settings as ppo
from causalbench.core.learners.sac import settings as sac

LearnerSettings = sac.SACSettings | ppo.PPOSettings


@dataclass(frozen=True)
class EvaluationSettings:
    """When and how a learner is evaluated: full task episodes from stage 1 on seeds of their own."""

    every: int = 2_000  # env steps between evaluations
    episodes: int = 20  # per evaluation, deterministic and sampled each
    final_episodes: int = 50  # after the last step

    def episodes_due(self, before: int, taken: int, env_steps: int) -> int:
        """Episodes of the evaluation that the steps from `before` to `taken` of `env_steps` make due; 0 if none."""
        if taken >= env_steps:
            return self.final_episodes
        return self.episodes if taken // self.every > before // self.every else 0


PRESETS: Mapping[str, Mapping[str, LearnerSettings]] = {"SAC": sac.PRESETS, "PPO": ppo.PRESETS}
"""Learner -> name -> starting point."""
