"""Pure manipulation with a slope in its last stage: closing the gripper pays there, not only the grasp that it ends in.

A variant for the question what the paper's sparse grasp makes of the other results; everything else is the same.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks import pure_manipulation as pure
from causalbench.core.tasks import pure_manipulation_data as data
from causalbench.core.tasks.reward_scales import SCALES
from causalbench.core.world.facts import Facts

Array = NDArray[np.float64]

GRIPPER = pure.TASK.term_names.index("r_gripper")


def rewards(
    previous: Facts, stage: NDArray[np.int64], action: Array, now: Facts, next_stage: NDArray[np.int64]
) -> Array:
    """Pure manipulation's reward vector (..., 9); in stage 4 `r_gripper` also pays what the gripper closed by."""
    out = pure.rewards(previous, stage, action, now, next_stage)
    closed = previous.gripper_opening - now.gripper_opening
    out[..., GRIPPER] += np.where(stage == data.N_STAGES, SCALES.distance * closed, 0.0)
    return out


CLOSING = dataclasses.replace(
    data.TERMS[GRIPPER], description="closing: a penalty before stage 4, every metre of it and the grasp in stage 4"
)
TASK = dataclasses.replace(
    pure.TASK,
    name="pure_manipulation_dense",
    env_id="causalbench/PureManipulationDense-v0",
    terms=tuple(CLOSING if term.name == CLOSING.name else term for term in data.TERMS),
    constants={**pure.TASK.constants, "closing": SCALES.distance},
    rewards=rewards,
)
