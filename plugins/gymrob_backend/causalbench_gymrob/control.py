"""One control step, compiled: servo targets and physics in a single call."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import arm_ik, compiled, joint_following
from causalbench_gymrob.model import FINGER_RANGE
from causalbench_mujoco.library import mj_step, mj_step2

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

GRIP_LEAD = 0.015  # m by which a finger's target may run ahead of the finger: 30 N of grip
LOWEST, HIGHEST = FINGER_RANGE


@compiled
def _move_fingers(qpos: Array, ctrl: Array, fingers: Indices, servos: Indices, closing: float) -> None:
    """Bring the pads' targets together by `closing` metres, both alike so that the grip stays centred.

    `fingers` (2,) and `servos` (2,) are addresses in `qpos` and `ctrl`. A target never runs more than `GRIP_LEAD`
    ahead of the fingers: the grip is firm, and opening starts at once.
    """
    finger = (qpos[fingers[0]] + qpos[fingers[1]]) / 2
    target = ctrl[servos[0]] - closing / 2
    target = min(max(target, finger - GRIP_LEAD, LOWEST), finger + GRIP_LEAD, HIGHEST)
    ctrl[servos[0]] = ctrl[servos[1]] = target


@compiled(nogil=True)
def control_step(
    model: int,
    data: int,
    parts: int,
    substeps: int,
    delta: Array,
    dt: float,
    chain: arm_ik.Chain,
    target: Array,
    joints: Array,
    qpos: Array,
    ctrl: Array,
    fingers: Indices,
    servos: Indices,
) -> None:
    """Advance by `parts` times `substeps` timesteps; before each part the targets move by `delta` in `dt` seconds.

    `model` and `data` are addresses. `delta` (7,): metres along the base axes, radians about the hand's axes,
    metres of closing. `target` and `joints` (7,) are views of the arm's parts of `ctrl` and `qpos`. Enters
    after `mj_step1`; leaves as `mj_step` does, with the contact forces of the last substep.
    """
    for part in range(parts):
        joint_following.follow(chain, target, joints, delta[:6], dt)
        if delta[6] != 0.0:
            _move_fingers(qpos, ctrl, fingers, servos, delta[6])
        for substep in range(substeps):
            if part == 0 and substep == 0:
                mj_step2(model, data)
            else:
                mj_step(model, data)
