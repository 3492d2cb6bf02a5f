"""Free boxes and the hand: which of them lie between the fingers, and how one that is held goes along.

All functions take one box a world, arrays (*shape, 3) and (*shape, 4), or several, then with a dimension n before the
last in every argument.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kinematic.spec import AROUND, UPRIGHT
from causalbench.core.numerics import rotations

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Frame = tuple[Array, Array]  # its origin and its rotation in the world


def enclosed(hand: Array, posture: Array, box: Array) -> Flags:
    """Whether boxes at `box` lie between the fingers of a hand at `hand`, turned by `posture`."""
    _, x, y, _ = posture.T
    dx, dy, dz = rotations.rotate(rotations.conjugate(posture), box - hand).T
    between = (abs(dx) < AROUND[0]) & (abs(dy) < AROUND[1]) & (abs(dz) < AROUND[2])
    return (between & (2 * (x * x + y * y) - 1 > math.cos(UPRIGHT))).T


def carried(turn: Array, hand: Array, old_hand: Array, box: Array, box_posture: Array) -> tuple[Array, Array]:
    """Where boxes are that go along with a hand that moved from `old_hand` to `hand` and turned by `turn`."""
    return hand + rotations.rotate(turn, box - old_hand), rotations.multiply(turn, box_posture)


def reframed(old: Frame, new: Frame, box: Array, posture: Array) -> tuple[Array, Array]:
    """Boxes that stay where they are in the world, seen from the frame `new` instead of from `old`."""
    place, turned = old[0] + rotations.rotate(old[1], box), rotations.multiply(old[1], posture)
    back = rotations.conjugate(new[1])
    return rotations.rotate(back, place - new[0]), rotations.multiply(back, turned)


def put_rows(table: Array, index: tuple[int, ...], rows: Array, absent: Array) -> Array:
    """`table` (*shape, n, k) with `rows` (m, k) in the world at `index`, () or (i,), grown to n >= m.

    What a world has fewer than the others are rows `absent` (k,).
    """
    more = len(rows) - table.shape[-2]
    if more > 0:
        table = np.concatenate([table, np.tile(absent, (*table.shape[:-2], more, 1))], axis=-2)
    table[index] = absent
    table[index][: len(rows)] = rows
    return table
