"""What all learners share: how their worlds are observed, and when and how they are evaluated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt

CriticLayout = Literal["rows", "heads", "terms"]
"""One critic per distinct row of the matrix, the same as heads of one network, or one critic per reward term."""

ScalarName = Literal["shaped", "paper", "first_entry"]
"""What a learner that climbs one reward makes of the reward vector: see `scalars`."""


@dataclass(frozen=True)
class StagedSettings:
    """What the staged loop reads of a learner's settings; the record of a learner that trains in it inherits these."""

    n_envs: Annotated[int, Gt(0)] = 1  # scenes stepped by one learner
    observe_gripper: bool = True  # ours; the paper's observation has no gripper opening
    # "sectors": how near something is in each sector of the LiDAR, too; "paper": image or LiDAR through convolutions.
    observation: Literal["state", "sectors", "paper"] = "state"
    features: bool = True  # ours; what the task computes from the state, `StageTask.features`
    bonus: Literal["every_entry", "first_entry"] = "every_entry"  # what a step into a later stage pays it for
    full_stages: tuple[Annotated[int, Gt(0)], ...] = ()  # where a method with a graph acts and learns without it


OBSERVED: Mapping[str, Any] = {"observe_gripper": True, "observation": "state", "features": True}
"""Settings that say what a policy observes, and what stands for those that a learner does not have."""


def observed(settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a policy observes that was trained with `settings`: the values of `OBSERVED`'s keys."""
    return {key: settings.get(key, default) for key, default in OBSERVED.items()}


FIRST_START = 2_000_000
"""Seed of the first start that results are reported on, apart from any training start; earlier ones served searches."""


@dataclass(frozen=True)
class EvaluationSettings:
    """When and how a learner is evaluated: full task episodes from stage 1, the same starts for every method and seed.

    Start i of an evaluation is drawn with the seed `first_start` + i. A training run that `stop_after` ends gets its
    final evaluation then, and its success curve goes on at what that says.
    """

    every: Annotated[int, Gt(0)] = 2_000  # env steps between evaluations
    episodes: Annotated[int, Gt(0)] = 20  # per evaluation, deterministic
    final_episodes: Annotated[int, Gt(0)] = 50  # after the last step, deterministic and sampled each
    stop_after: Annotated[int, Ge(0)] = 0  # evaluations in a row without a failure that end training; 0: none do
    first_start: Annotated[int, Ge(0)] = FIRST_START  # searches and tuning take others than what is reported

    def episodes_due(self, before: int, taken: int, env_steps: int) -> int:
        """Episodes of the evaluation that the steps from `before` to `taken` of `env_steps` make due; 0 if none."""
        if taken >= env_steps:
            return self.final_episodes
        return self.episodes if taken // self.every > before // self.every else 0
