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
    """The settings that `train_staged` reads; the settings of a learner that uses it inherit these."""

    n_envs: Annotated[int, Gt(0)] = 1  # worlds that step together in one training
    observe_gripper: bool = True  # adds the opening of the gripper, which the paper does not observe
    # "sectors" adds 20 numbers of the LiDAR; "paper" adds the image or the LiDAR, through convolutions.
    observation: Literal["state", "sectors", "paper"] = "state"
    features: bool = True  # adds the task's features, which the paper does not observe
    bonus: Literal["every_entry", "first_entry"] = "every_entry"  # which steps into a later stage pay it
    full_stages: tuple[Annotated[int, Gt(0)], ...] = ()  # stages in which a method ignores its graph


OBSERVED: Mapping[str, Any] = {"observe_gripper": True, "observation": "state", "features": True}
"""Settings that say what a policy observes, and what stands for those that a learner does not have."""


def observed(settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a policy observes that was trained with `settings`: the values of `OBSERVED`'s keys."""
    return {key: settings.get(key, default) for key, default in OBSERVED.items()}


FIRST_START = 2_000_000
"""Seed of the first start that results are reported on, apart from any training start; earlier ones served searches."""


@dataclass(frozen=True)
class EvaluationSettings:
    """When and how a learner is evaluated: in full task episodes from stage 1, with the same starts for all methods.

    Start i of an evaluation is drawn with the seed `first_start` + i. If `stop_after` ends a training, the final
    evaluation is made at once, and the rest of the success curve has its value.
    """

    every: Annotated[int, Gt(0)] = 2_000  # environment steps between evaluations
    episodes: Annotated[int, Gt(0)] = 20  # in each evaluation, with the deterministic policy
    final_episodes: Annotated[int, Gt(0)] = 50  # after the last step, with each of both policies
    stop_after: Annotated[int, Ge(0)] = 0  # ends training after so many evaluations without a failure; 0: never
    first_start: Annotated[int, Ge(0)] = FIRST_START  # seed of the first start; tuning should take others

    def episodes_due(self, before: int, taken: int, env_steps: int) -> int:
        """Episodes of the evaluation that the steps from `before` to `taken` of `env_steps` make due; 0 if none."""
        if taken >= env_steps:
            return self.final_episodes
        return self.episodes if taken // self.every > before // self.every else 0
