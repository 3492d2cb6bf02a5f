"""Plans of one stage's agent, as a causal matrix would give them, for tests of agents by themselves."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from causalbench.core.learners.causal_gradient import StagePlan
from causalbench.core.learners.settings import CriticLayout

MATRIX = [[1, 0, 1], [0, 1, 1], [1, 1, 0]]
"""Actions by reward terms: none has the row of another, and every term has two causes."""


def plan(mask: Any, joint_twin: bool = False, entropy: Any = None) -> StagePlan:
    """Of an agent whose action k climbs critic c where `mask[k, c]`, one reward term each."""
    mask = np.array(mask, dtype=bool)
    n_critics = mask.shape[1]
    bonus = np.ones(n_critics, dtype=bool) if entropy is None else np.array(entropy, dtype=bool)
    return StagePlan(np.arange(len(mask)), np.eye(n_critics, dtype=bool), mask, bonus, joint_twin)


class Form(NamedTuple):
    """A plan, and how its critics are built."""

    plan: StagePlan
    critics: CriticLayout = "rows"


FORMS = {
    "scalar": Form(plan(np.ones((3, 1)))),
    "one action": Form(plan([[1]])),
    "rows": Form(plan(MATRIX)),
    "heads": Form(plan(MATRIX), "heads"),
    "terms": Form(plan(MATRIX, joint_twin=True, entropy=[0, 0, 1]), "terms"),
}
"""Every kind of plan that a learner can be given; PPO has no heads of its own."""
