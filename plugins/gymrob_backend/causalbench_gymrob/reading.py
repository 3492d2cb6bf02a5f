"""What is read out of MuJoCo after a control step: contact flags, pad forces and poses, in one compiled pass each."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from causalbench.core.compiled import compiled
from causalbench_gymrob.model import FINGERS, OBJECT, is_arm

Array = NDArray[np.float64]

FIXTURE, FLOOR, BASE, ARM, LEFT, RIGHT, TARGET = range(7)
"""Classes of geoms. LEFT and RIGHT are the fingers; ARM is the arm and the palm."""

HOLDING_FORCE = 5.0  # N of each pad on the object: two and a half times the weight of the task's box


def geom_classes(model: mujoco.MjModel) -> NDArray[np.int64]:
    """The class of every geom, (ngeom,)."""
    classes = np.full(model.ngeom, FIXTURE)
    for i in range(model.ngeom):
        body = model.body(model.geom_bodyid[i]).name
        if body in FINGERS:
            classes[i] = LEFT + FINGERS.index(body)
        elif body.startswith("robot0:"):
            classes[i] = ARM if is_arm(body) else BASE
        elif body == OBJECT:
            classes[i] = TARGET
        elif model.geom(i).name == "floor0":
            classes[i] = FLOOR
    return classes


@compiled
def pad_forces(
    geoms: NDArray[np.int32], address: NDArray[np.int32], force: Array, classes: NDArray[np.int64], out: Array
) -> None:
    """`out` (2,) = normal force in N between the object and the left and the right finger.

    `geoms` (ncon, 2), `address` (ncon,) and `force` (nefc,) are MuJoCo's after a solved substep. With the
    elliptic cone the first row of a contact is its normal force.
    """
    out[:] = 0.0
    for i in range(geoms.shape[0]):
        a, b = classes[geoms[i, 0]], classes[geoms[i, 1]]
        low, high = min(a, b), max(a, b)
        if high == TARGET and low in (LEFT, RIGHT) and address[i] >= 0:
            out[low - LEFT] += force[address[i]]


@compiled
def _contact_flags(geoms: NDArray[np.int32], classes: NDArray[np.int64], out: NDArray[np.bool_]) -> None:
    """`out` (3,) = the base touches a fixture, the arm touches a fixture, the robot touches itself.

    `geoms` (ncon, 2) are MuJoCo's contacts, which all touch: no margin. Neither the floor nor the object counts.
    """
    out[:] = False
    for i in range(geoms.shape[0]):
        a, b = classes[geoms[i, 0]], classes[geoms[i, 1]]
        low, high = min(a, b), max(a, b)
        if high == TARGET:
            continue
        if low >= BASE:
            out[2] = True
        elif low == FIXTURE and high == BASE:
            out[0] = True
        elif low == FIXTURE and high > BASE:
            out[1] = True


@compiled
def _put_canonical(w: float, x: float, y: float, z: float, out: Array) -> None:
    """`out` (4,) = the unit quaternion with the project's sign, as `causalbench.core.rotations.canonical`."""
    scale = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
    if w < 0:
        scale = -scale
    out[0], out[1], out[2], out[3] = w * scale, x * scale, y * scale, z * scale


@compiled
def read(
    geoms: NDArray[np.int32],
    classes: NDArray[np.int64],
    forces: Array,
    position: Array,
    matrix: Array,
    qpos: Array,
    qvel: Array,
    base: NDArray[np.int64],
    fingers: NDArray[np.int64],
    free: int,
    gap: float,
    out: Array,
    flags: NDArray[np.bool_],
) -> None:
    """All facts: `out` (20,) = hand pose 3 + 4, opening, object pose 3 + 4, base pose 3 and velocity 2; `flags` (4,).

    The flags are those of `_contact_flags` and, last, whether both pads press on the object with more than
    `HOLDING_FORCE`. `position` (3,) and `matrix` (9,) of the hand; `base` (3,) holds the addresses of the base joints
    (their velocities have the same), `fingers` (2,) those of the fingers, `free` that of the object; `forces` (2,)
    are those of `pad_forces`; `gap` is the distance in metres between closed pads.
    """
    _contact_flags(geoms, classes, flags[:3])
    flags[3] = min(forces[0], forces[1]) > HOLDING_FORCE
    m = matrix
    out[0:3] = position
    # Shepperd: divide by the largest of the four components.
    trace = m[0] + m[4] + m[8]
    if trace > max(m[0], m[4], m[8]):
        _put_canonical(1 + trace, m[7] - m[5], m[2] - m[6], m[3] - m[1], out[3:7])
    elif m[0] >= m[4] and m[0] >= m[8]:
        _put_canonical(m[7] - m[5], 1 + 2 * m[0] - trace, m[1] + m[3], m[2] + m[6], out[3:7])
    elif m[4] >= m[8]:
        _put_canonical(m[2] - m[6], m[1] + m[3], 1 + 2 * m[4] - trace, m[5] + m[7], out[3:7])
    else:
        _put_canonical(m[3] - m[1], m[2] + m[6], m[5] + m[7], 1 + 2 * m[8] - trace, out[3:7])
    out[7] = qpos[fingers[0]] + qpos[fingers[1]] + gap
    out[8:11] = qpos[free : free + 3]
    _put_canonical(qpos[free + 3], qpos[free + 4], qpos[free + 5], qpos[free + 6], out[11:15])
    for i in range(3):
        out[15 + i] = qpos[base[i]]
    cos, sin = np.cos(out[17]), np.sin(out[17])
    out[18] = cos * qvel[base[0]] + sin * qvel[base[1]]
    out[19] = qvel[base[2]]
