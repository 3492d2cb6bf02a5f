"""Every number that soft actor-critic needs, with the paper's values beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from causalbench.core.learners.settings import CriticLayout, StagedSettings


@dataclass(frozen=True)
class SACSettings(StagedSettings):
    """Settings of the learner `SAC`, for the agent of each stage. The preset `paper` has the values of the paper."""

    net_arch: tuple[Annotated[int, Gt(0)], ...] = (64, 64)  # units of each hidden layer, of actor and critics
    batch_size: Annotated[int, Gt(0)] = 256  # samples in a gradient step
    learning_rate: Annotated[float, Gt(0)] = 1e-3  # of Adam, for actor, critics and entropy
    gamma: Annotated[float, Gt(0), Le(1)] = 0.99  # discount of a control step
    tau: Annotated[float, Gt(0), Le(1)] = 0.005  # soft target update factor
    buffer_size: Annotated[int, Gt(0)] = 10_000  # samples kept per stage
    learning_starts: Annotated[int, Ge(0)] = 500  # random samples per stage before its first update
    train_every: Annotated[int, Gt(0)] = 32  # new samples of a stage that start its training (Algorithm 3, `count`)
    updates_per_sample: Annotated[float, Gt(0)] = 0.25  # gradient steps for each new sample
    ent_coef_init: Annotated[float, Gt(0)] = 0.05  # entropy coefficient at the start; SB3's "auto" has 1.0
    cooperation_weight: Annotated[float, Ge(0), Le(1)] = 0.3  # share of the next stage's critic in cSAC
    critics: CriticLayout = "rows"  # one for each distinct row (`heads`: in one network) or term
    engine: Literal["fused", "autograd"] = "fused"  # makes the gradients: written out, or by autograd


PRESETS: Mapping[str, SACSettings] = {
    "quick": SACSettings(),
    "paper": SACSettings(
        net_arch=(512, 512),
        batch_size=512,
        learning_rate=5e-4,
        train_every=1000,
        updates_per_sample=1.0,
        learning_starts=1000,
        critics="heads",  # the paper does not say; networks of their own make an update cost 1.9 times as much
        observe_gripper=False,
        features=False,
    ),
}
"""Name -> starting point; the paper's is its hyperparameter table and its section Neural Network Architecture."""
