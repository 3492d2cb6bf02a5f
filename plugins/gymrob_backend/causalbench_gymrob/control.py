"""The gripper's servo targets. Those of the arm are `causalbench.core.arm_ik.follow`."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from causalbench_gymrob.model import FINGER_RANGE

Array = NDArray[np.float64]

GRIP_LEAD = 0.015  # m by which a finger's target may run ahead of the finger: 30 N of grip
LOWEST, HIGHEST = FINGER_RANGE


@nb.njit(cache=True)
def move_fingers(
    qpos: Array, ctrl: Array, fingers: NDArray[np.int64], servos: NDArray[np.int64], closing: float
) -> None:
    """Bring the pads' targets together by `closing` metres, both alike so that the grip stays centred.

    `fingers` (2,) and `servos` (2,) are addresses in `qpos` and `ctrl`. A target never runs more than `GRIP_LEAD`
    ahead of the fingers: the grip is firm, and opening starts at once.
    """
    finger = (qpos[fingers[0]] + qpos[fingers[1]]) / 2
    target = ctrl[servos[0]] - closing / 2
    target = min(max(target, finger - GRIP_LEAD, LOWEST), finger + GRIP_LEAD, HIGHEST)
    ctrl[servos[0]] = ctrl[servos[1]] = target
