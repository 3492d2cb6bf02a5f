"""The scales of every task's rewards in one place; the paper prints none."""

from __future__ import annotations

DISTANCE_SCALE = 10.0  # reward per metre (lambda of the paper, Reward Setting)
ANGLE_SCALE = 2.0  # reward per radian
STAGE_BONUS = 2.0
COLLISION = -0.5
HORIZON = 200  # control steps
