"""The table of methods: each of the paper's methods is a configuration of a learner, and so is each control.

A name reads left to right: cm (causal actions and mask) or cmm (the same, matrix by hand), m (one agent a stage, no
causes) or c (cooperating stages), the learner, and after a hyphen the one thing in which the row differs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Control = Literal["none", "shuffled", "redrawn", "plus1", "plus2", "other"]


@dataclass(frozen=True)
class Method:
    """A method: a learner with an action space, a gradient and a causal matrix.

    `learner`: the name of the registered learner that trains it;
    `action_space`: "causal" builds each stage's policy from its causal actions only (paper, eq. CausalActions);
    `gradient`: "factored" lets action k learn only from the terms it causes (paper, Causal Policy Gradient);
    `matrix`: where the causal matrix comes from; `cooperation`: whether the actor also climbs the next
    stage's critic (Erskine and Lehnert 2022); `control`: how the matrix is spoilt before it is used (`controls`);
    `discoverer`: the name of the one that finds a discovered matrix, whichever a suite has for other methods; "" for
    the suite's. Raises `ValueError` for a discoverer where no matrix is discovered.
    """

    name: str
    learner: str
    action_space: Literal["causal", "full"]
    gradient: Literal["factored", "scalar"]
    matrix: Literal["discovered", "manual", "oracle", "none"]
    cooperation: bool = False
    control: Control = "none"
    discoverer: str = ""

    def __post_init__(self) -> None:
        if self.discoverer and self.matrix != "discovered":
            raise ValueError(
                f"method {self.name!r}: discoverer {self.discoverer!r} would be ignored, since its matrix is "
                f"{self.matrix!r} and not 'discovered'; leave it out"
            )

    @property
    def identity(self) -> dict[str, Any]:
        """What of it enters a cell's id: all fields, a discoverer only where there is one."""
        return {key: value for key, value in asdict(self).items() if key != "discoverer" or value}


PAPER = (
    Method("cmSAC", "SAC", "causal", "factored", "discovered"),
    Method("cmmSAC", "SAC", "causal", "factored", "manual"),
    Method("mSAC", "SAC", "full", "scalar", "none"),
    Method("cSAC", "SAC", "full", "scalar", "none", cooperation=True),
    Method("cmPPO", "PPO", "causal", "factored", "discovered"),
    Method("cmmPPO", "PPO", "causal", "factored", "manual"),
    Method("mPPO", "PPO", "full", "scalar", "none"),
)

ONE_AGENT = (
    Method("SAC", "SB3-SAC", "full", "scalar", "none"),
    Method("PPO", "SB3-PPO", "full", "scalar", "none"),
)
"""One agent of stable-baselines3's for all stages, on one reward: see `scalars`."""


def _ablations(learner: str) -> tuple[Method, ...]:
    """What differs from cmSAC or cmPPO in one thing."""
    cm = f"cm{learner}"
    return (
        # One half of the method without the other.
        Method(f"{cm}-scalar", learner, "causal", "scalar", "discovered"),
        Method(f"{cm}-full", learner, "full", "factored", "discovered"),
        # Does the mask help by what it says, or by being sparse?
        Method(f"{cm}-shuffled", learner, "causal", "factored", "discovered", control="shuffled"),
        Method(f"{cm}-redrawn", learner, "causal", "factored", "discovered", control="redrawn"),
        # Do the actions help by being the causal ones, or by being few?
        Method(f"{cm}-plus1", learner, "causal", "factored", "discovered", control="plus1"),
        Method(f"{cm}-plus2", learner, "causal", "factored", "discovered", control="plus2"),
        Method(f"{cm}-other", learner, "causal", "factored", "discovered", control="other"),
        # What the paper's own discovery gives, and what a perfect one would.
        Method(f"{cm}-kl", learner, "causal", "factored", "discovered", discoverer="kl"),
        Method(f"{cm}-oracle", learner, "causal", "factored", "oracle"),
    )


METHODS = (*PAPER, *ONE_AGENT, *_ablations("SAC"), *_ablations("PPO"))
