"""What is read out of MuJoCo's arrays after a control step, in one compiled pass each: contact flags, forces, poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import HOLDING_FORCE, compiled, kernels

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FIXTURE, BASE, ARM, LEFT, RIGHT, TARGET, OTHER = range(7)
"""Classes of geoms. LEFT and RIGHT are the fingers; ARM is the arm and the palm, BASE what else the robot is made of.

The floor is a fixture. OTHER is a free box beside the target, which is no collision, either.
"""


@compiled
def pad_forces(
    geoms: NDArray[np.int32],
    address: NDArray[np.int32],
    frames: Array,
    force: Array,
    hand: Array,
    classes: Indices,
    out: Array,
) -> None:
    """`out` (2,) = force in N along the closing axis between the object and the left and the right finger.

    `geoms` (ncon, 2), `address` (ncon,), `frames` (ncon, 9) and `force` (nefc,) are those of a solved substep,
    `hand` (9,) the end effector's matrix. The first row of a contact is its normal force.
    Only the normal's part along the closing axis counts: fingertips that stand on the object do not hold it.
    """
    out[:] = 0.0
    for i in range(geoms.shape[0]):
        a, b = classes[geoms[i, 0]], classes[geoms[i, 1]]
        low, high = min(a, b), max(a, b)
        if high == TARGET and low in (LEFT, RIGHT) and address[i] >= 0:
            share = frames[i, 0] * hand[1] + frames[i, 1] * hand[4] + frames[i, 2] * hand[7]
            out[low - LEFT] += force[address[i]] * abs(share)


@compiled
def _contact_flags(geoms: NDArray[np.int32], classes: Indices, out: NDArray[np.bool_]) -> None:
    """`out` (3,) = the base touches a fixture, the arm touches a fixture, the robot touches itself.

    `geoms` (ncon, 2) are all contacts, and all touch: no margin. Free objects do not count, nor do closed
    fingers that touch each other.
    """
    out[:] = False
    for i in range(geoms.shape[0]):
        a, b = classes[geoms[i, 0]], classes[geoms[i, 1]]
        low, high = min(a, b), max(a, b)
        if high >= TARGET or (low == LEFT and high == RIGHT):
            continue
        if low >= BASE:
            out[2] = True
        elif high == BASE:
            out[0] = True
        elif high > BASE:
            out[1] = True


@compiled
def read(
    geoms: NDArray[np.int32],
    classes: Indices,
    forces: Array,
    position: Array,
    matrix: Array,
    target: Array,
    out: Array,
    flags: NDArray[np.bool_],
) -> None:
    """Poses and flags: `out` (14,) = hand pose 3 + 4 and object pose 3 + 4; `flags` (4,).

    The flags are those of `_contact_flags` and, last, whether both pads press on the object with more than
    `HOLDING_FORCE`. `position` (3,) and `matrix` (9,) of the hand; `target` (7,) is the object's pose, of about
    unit length; `forces` (2,) are those of `pad_forces`.
    """
    _contact_flags(geoms, classes, flags[:3])
    flags[3] = min(forces[0], forces[1]) > HOLDING_FORCE
    out[0:3] = position
    kernels.from_matrix(matrix, out[3:7])
    out[7:10] = target[:3]
    kernels.canonical(target[3], target[4], target[5], target[6], out[10:14])
