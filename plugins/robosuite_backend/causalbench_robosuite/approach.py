"""How a hand comes to hold a thing from above, in three stages: open above it (1), lower the hand (2), close it (3).

In a fourth it holds it. robosuite's are its grasp, pads that touch the thing, and its reaching part; the rest is ours.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import Term
from causalbench_robosuite import tcp

Array = NDArray[np.float64]


class Approach(NamedTuple):
    """Every number of it; metres and radians."""

    width: float  # between the fingers around the thing
    hover: float = 0.08  # of the hand above the thing, where stage 1 ends
    beside: float = 0.015  # of the hand off the thing, each axis, in stages 2 and 3
    level: float = 0.15  # of tilt and yaw, where stage 1 ends
    open: float = 0.07  # between the fingers, where stage 1 ends
    per_metre: float = 10.0
    per_radian: float = 2.0
    per_part: float = 2.0  # of robosuite's own rewards


STATE_NAMES = (
    *("hand_x", "hand_y", "hand_z", "off_x", "off_y", "off_z"),
    *("tilt_x", "tilt_y", "yaw", "fingers", "grasped"),
)
N = len(STATE_NAMES)
LOW = np.array([-0.6, -0.6, 0.78, *[-0.5] * 3, *[-1.0] * 2, -2.8, -0.005, -0.01])
HIGH = np.array([0.6, 0.6, 1.4, *[0.5] * 3, *[1.0] * 2, 2.8, 0.085, 1.01])


TERMS = (
    Term("r_x", (1,), True, "approach of the hand to the thing along x"),
    Term("r_y", (1,), True, "approach of the hand to the thing along y"),
    Term("r_z", (1,), True, "approach of the hand to the hover height"),
    Term("r_rx", (1,), True, "turning the hand down about x"),
    Term("r_ry", (1,), True, "turning the hand down about y"),
    Term("r_rz", (1,), True, "turning the fingers to the thing"),
    Term("r_open", (1,), True, "opening of the fingers"),
    Term("r_lower", (2,), True, "approach of the hand to the thing's height"),
    Term("r_reach", (2,), True, "robosuite's reaching part, its change"),
    Term("r_close", (3,), True, "closing of the fingers"),
    Term("r_grasp", (3,), True, "robosuite's grasp, its change"),
)
CAUSES = {
    1: {"r_x": "x", "r_y": "y", "r_z": "z", "r_rx": "rx", "r_ry": "ry", "r_rz": "rz", "r_open": "grip"},
    2: {"r_lower": "z", "r_reach": "x y z"},
    3: {"r_close": "grip", "r_grasp": "grip"},
}


def terms_of(*hands: str) -> tuple[Term, ...]:
    """`TERMS` of each of several hands in turn: "r_x" is "r_a_x" for the hand "a"."""
    return tuple(replace(term, name=_of(hand, term.name)) for hand in hands for term in TERMS)


def causes_of(*hands: str) -> dict[int, dict[str, str]]:
    """`CAUSES` of several hands, of which each has its own actions: "x" is "a_x" for the hand "a"."""
    return {
        stage: {_of(h, term): " ".join(f"{h}_{a}" for a in c.split()) for h in hands for term, c in row.items()}
        for stage, row in CAUSES.items()
    }


def _of(hand: str, term: str) -> str:
    return term.replace("r_", f"r_{hand}_", 1)


def look(robot: Any, hold: Array, yaw: float, grasped: bool) -> Array:
    """The state variables (11,): `hold` (3,) m is where the hand belongs, `yaw` how far its fingers are turned off.

    The hand is in the world, what it is off in the axes of its base.
    """
    hand, ahead = tcp.position(robot), np.clip(tcp.axes(robot)[:2, 2], -1.0, 1.0)
    off, tilt = tcp.base(robot).T @ (hold - hand), np.arcsin([ahead[1], -ahead[0]])
    return np.array([*hand, *off, *tilt, yaw, tcp.fingers(robot), grasped])


def stage(c: Approach, state: Array) -> int:
    """U(s), from 1 to 4."""
    off = np.abs(state[3:6])
    if state[10]:
        return 4
    if (off < c.beside).all():
        return 3
    ready = bool((off[:2] < c.beside).all() and (np.abs(state[6:9]) < c.level).all())
    return 2 if ready and state[5] < 0 and state[9] > c.open else 1


def left(c: Approach, state: Array, reach: float) -> Array:
    """What the terms pay for getting smaller (11,)."""
    off, fingers = state[3:6], state[9]
    to_open, to_close = max(c.open - fingers, 0.0), max(fingers - c.width, 0.0)
    return np.array([
        *(c.per_metre * np.abs([off[0], off[1], off[2] + c.hover])), *(c.per_radian * np.abs(state[6:9])),
        c.per_metre * to_open, c.per_metre * abs(off[2]), -c.per_part * reach,
        c.per_metre * to_close, -c.per_part * state[10],
    ])  # fmt: skip


def expert(c: Approach, state: Array, u: int) -> Array:
    """Proportional control (7,) of what stage `u` asks for; from 4 on of the hand to the thing, closed."""
    move, grip = state[3:6].copy(), -1.0 if u < 3 else 1.0
    if u == 1:
        move[2] += c.hover
        move[:2] *= move[2] < 0.02  # up first
    return drive(state, move, grip)


def drive(state: Array, move: Array, grip: float) -> Array:
    """Control (7,) that moves the hand by `move` (3,) m in the axes of its base, and levels it."""
    return np.clip([*(15.0 * move), *(-2.0 * state[6:9]), grip], -1.0, 1.0)
