"""Settings of stable-baselines3's own agents, with the presets of the staged learners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Gt, Le

from causalbench.core.learners.ppo import settings as ppo
from causalbench.core.learners.sac import settings as sac
from causalbench.core.learners.settings import ScalarName

ABOUT = "stable-baselines3's own agent, one for all stages, on one reward"


@dataclass(frozen=True)
class SB3SACSettings:
    """Settings of stable-baselines3's `SAC`, which has no convolutions."""

    net_arch: tuple[Annotated[int, Gt(0)], ...] = (64, 64)  # units of each hidden layer, of actor and critics
    batch_size: Annotated[int, Gt(0)] = 256  # samples in a gradient step
    learning_rate: Annotated[float, Gt(0)] = 1e-3  # of Adam
    gamma: Annotated[float, Gt(0), Le(1)] = 0.99  # discount of a control step
    tau: Annotated[float, Gt(0), Le(1)] = 0.005  # soft target update factor
    buffer_size: Annotated[int, Gt(0)] = 10_000  # samples kept per stage of the task
    learning_starts: Annotated[int, Ge(0)] = 500  # random samples before the first update
    train_every: Annotated[int, Gt(0)] = 32  # env steps, of all worlds together, between trainings
    updates_per_sample: Annotated[float, Gt(0)] = 0.25  # gradient steps for each new sample
    ent_coef_init: Annotated[float, Gt(0)] = 0.05  # entropy coefficient at the start; SB3's "auto" has 1.0
    n_envs: Annotated[int, Gt(0)] = 1  # worlds that step together in one training
    observe_gripper: bool = True  # adds the opening of the gripper, which the paper does not observe
    observation: Literal["state", "sectors"] = "state"  # "sectors" adds 20 numbers of the LiDAR
    scalar: ScalarName = "shaped"  # the one reward; "paper": the sum of the terms, which pays for falling back
    features: bool = True  # adds the task's features, which the paper does not observe


@dataclass(frozen=True)
class SB3PPOSettings:
    """Settings of stable-baselines3's `PPO`, which has no convolutions."""

    net_arch: tuple[Annotated[int, Gt(0)], ...] = (64, 64)  # units of each hidden layer, of actor and critics
    n_steps: Annotated[int, Gt(0)] = 1_024  # env steps in an epoch, of all worlds together
    n_epochs: Annotated[int, Gt(0)] = 10  # passes over an epoch's samples
    batch_size: Annotated[int, Gt(0)] = 64  # samples in a gradient step
    learning_rate: Annotated[float, Gt(0)] = 3e-4  # of Adam
    gamma: Annotated[float, Gt(0), Le(1)] = 0.99  # discount of a control step
    gae_lambda: Annotated[float, Ge(0), Le(1)] = 0.95  # of generalised advantage estimation
    clip_range: Annotated[float, Gt(0)] = 0.2  # how far a probability ratio may move from 1
    target_kl: Annotated[float, Gt(0)] = 0.03  # an epoch's training stops when the policy moved 1.5 times as far
    ent_coef: Annotated[float, Ge(0)] = 0.0  # weight of the entropy bonus
    vf_coef: Annotated[float, Ge(0)] = 0.5  # weight of the value loss
    max_grad_norm: Annotated[float, Gt(0)] = 0.5  # longer gradients are shortened to this length
    log_std_init: float = -0.5  # SB3's 0.0 puts a third of all first actions on their bounds
    n_envs: Annotated[int, Gt(0)] = 1  # worlds that step together in one training
    observe_gripper: bool = True  # adds the opening of the gripper, which the paper does not observe
    observation: Literal["state", "sectors"] = "state"  # "sectors" adds 20 numbers of the LiDAR
    scalar: ScalarName = "shaped"  # the one reward; "paper": the sum of the terms, which pays for falling back
    features: bool = True  # adds the task's features, which the paper does not observe


OWN = ("scalar",)
"""Settings that no staged learner has."""

RecordT = TypeVar("RecordT", SB3SACSettings, SB3PPOSettings)


def _presets(record: type[RecordT], staged: Mapping[str, Any]) -> dict[str, RecordT]:
    """The presets of a staged learner, as far as `record` has their settings: one thing differs between the rows."""
    names = [field.name for field in fields(record) if field.name not in OWN]
    return {name: record(**{key: getattr(preset, key) for key in names}) for name, preset in staged.items()}


SAC_PRESETS = _presets(SB3SACSettings, sac.PRESETS)
PPO_PRESETS = _presets(SB3PPOSettings, ppo.PRESETS)
