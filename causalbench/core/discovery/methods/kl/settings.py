"""Settings of the paper's discoverer: its models, the direction of its divergence, Algorithm 2 and the placebos."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from causalbench.core.discovery.reward_model.settings import PAPER, PAPER_LARGE, RewardModelSettings

Direction = Literal["forward", "reverse", "symmetric"]
"""KL(P1||P2), KL(P2||P1), their mean; P1 = p(r | s, do(a_k = 0)), P2 = p(r | s, random a_k)."""


@dataclass(frozen=True)
class KLSettings(RewardModelSettings):
    """Own settings of the discoverer; the three epsilons are Algorithm 2's."""

    sigma_kl: Annotated[float, Ge(0)] = 0.2  # sigma floor when KL is computed, in deviations of the term
    direction: Direction = "reverse"  # of the divergence: KL(P1||P2), KL(P2||P1) or their mean
    epsilon_cv: Annotated[float, Ge(0)] = 1.0  # coefficient of variation above which KLs are scaled to [0, 1]
    epsilon_normalize: Annotated[float, Ge(0)] = 0.1  # what the scaled KL of a cause exceeds
    epsilon_direct: Annotated[float, Ge(0)] = 0.01  # what the KL of a cause exceeds where it is not scaled
    placebo_gate: Annotated[float, Ge(0)] = 3.0  # an action counts only above this times the largest placebo's KL
    placebo_sets: Annotated[int, Gt(0)] = 5  # data sets, with models of their own, in which every placebo is probed
    select: Literal["paper", "fdr"] = "paper"  # Algorithm 2 with the gate, or the placebos' distribution alone
    fdr: Annotated[float, Gt(0), Le(1)] = 0.05  # share of wrong edges among the selected that `select: fdr` allows


PRESETS = {"quick": KLSettings(), "paper": KLSettings(**PAPER), "paper_large": KLSettings(**PAPER_LARGE)}
"""By the names of the shared presets."""
