"""What a compiled model tells about an arm and its gripper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from causalbench.backend import arm_ik
from causalbench_mujoco.engine import mujoco

HAND = "eef"
"""Name of the site of the end effector, its z along the approach axis and its y along the closing axis."""


def arm_chain(model: mujoco.MjModel, joints: Sequence[str], margin: float = 0.0) -> arm_ik.Chain:
    """The kinematics of the arm with hinges `joints`, from the world's origin to the site `HAND`.

    The model must be as compiled: with the robot's base in the origin. `margin` rad is kept from every limit.
    """
    data, ids = mujoco.MjData(model), [model.joint(name).id for name in joints]
    data.qpos[model.jnt_qposadr[ids]] = 0.0
    mujoco.mj_kinematics(model, data)
    limits = np.where(model.jnt_limited[ids, None], model.jnt_range[ids] + [margin, -margin], [-np.inf, np.inf])
    hand = data.site(HAND)
    return arm_ik.chain_at_zero(data.xanchor[ids], data.xaxis[ids], limits, hand.xpos, hand.xmat.reshape(3, 3))


def closed_gap(model: mujoco.MjModel, pads: Sequence[str]) -> float:
    """Distance in metres between the inner faces of the boxes `pads` with the finger joints at 0.

    Fingers close along the y axis of the hand, and so do the axes of the bodies that carry the pads.
    """
    gap = 0.0
    for name in pads:
        geom = model.geom(name)
        body = model.body(int(geom.bodyid[0]))
        gap += abs(float(body.pos[1] + geom.pos[1])) - float(geom.size[1])
    return gap
