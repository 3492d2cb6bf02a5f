"""The scales of every task's rewards in one place; the paper prints none."""

from __future__ import annotations

from typing import NamedTuple


class RewardScales(NamedTuple):
    """What a metre, a radian and an event are worth in the reward terms of all tasks."""

    distance: float = 10.0  # per metre (lambda of the paper, Reward Setting)
    angle: float = 2.0  # per radian
    stage_bonus: float = 2.0
    collision: float = -0.5


SCALES = RewardScales()
HORIZON = 200  # control steps
