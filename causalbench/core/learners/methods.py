"""The table of methods: each of the paper's methods is a configuration of one staged learner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Method:
    """One row of the table.

    `action_space`: "causal" builds each stage's policy from its causal actions only (paper, eq. CausalActions);
    `gradient`: "factored" lets action k learn only from the terms it causes (paper, Causal Policy Gradient);
    `matrix`: where the causal matrix comes from; `cooperation`: whether the actor also climbs the next
    stage's critic (Erskine and Lehnert 2022).
    """

    name: str
    learner: Literal["SAC", "PPO"]
    action_space: Literal["causal", "full"]
    gradient: Literal["factored", "scalar"]
    matrix: Literal["discovered", "manual", "none"]
    cooperation: bool = False


METHODS = (
    Method("cmSAC", "SAC", "causal", "factored", "discovered"),
    Method("cmmSAC", "SAC", "causal", "factored", "manual"),
    Method("mSAC", "SAC", "full", "scalar", "none"),
    Method("cSAC", "SAC", "full", "scalar", "none", cooperation=True),
    Method("cmPPO", "PPO", "causal", "factored", "discovered"),
    Method("cmmPPO", "PPO", "causal", "factored", "manual"),
    Method("mPPO", "PPO", "full", "scalar", "none"),
)
