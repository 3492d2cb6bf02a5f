"""Names and numbers of stacking: constants, reward terms, state variables, the human's graph."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from causalbench.core.tasks import pure_manipulation_data as pure
from causalbench.core.tasks.reward_scales import SCALES
from causalbench.core.tasks.stage_task import CausalSets, Term, causal_sets
from causalbench.core.tasks.stages import active_terms


class Constants(NamedTuple):
    """Every number that the task adds to those of pure manipulation; metres, radians, seconds and kilograms."""

    base_half_extents: tuple[float, float, float] = (0.06, 0.04, 0.02)
    base_mass: float = 0.4
    base_yaw: float = 0.1  # either way
    nearest: float = 0.45  # share of the workspace's half width, either side, that a box lies off the middle at least
    furthest: float = 0.80  # and at most
    carry: float = 0.05  # of the box above its place, to which it is lifted on the way there
    tolerance_carry: float = 0.02
    tolerance_xy: float = 0.02  # of the box beside its place, each world axis
    tolerance_rest: float = 0.03  # likewise, where it is let go: it slips as the fingers open
    sunk: float = 0.01  # of the box below its place, at most
    rest: float = 0.012  # of the box above its place, within which it is released
    clear: float = 0.008  # wider than the box are the fingers that let go of it
    squeezed: float = 0.014  # narrower than the box is the opening of a start that holds it
    off_centre: float = 0.01  # of the hand along the box, either way, there
    lowest: float = 0.05  # of the box above the table, from which a start of stage 5 may have carried it aside
    highest: float = 0.12  # likewise, at most
    on_the_way: float = 0.7  # share of the way to its place that it has come at most there
    lands: float = 0.004  # above its place, where the expert lets go
    rises: float = 0.03  # above its place, from which the expert carries the box aside
    careful: float = 0.4  # greatest action of the expert that lowers or carries the box
    farthest: float = 1.0  # of the box from its place, summed over the axes, from where on the potential is 0
    rest_time: float = 1.0  # s that the box stays after it was let go
    rest_way: float = 0.005  # that it moves at most in the second half of them


C = Constants()

N_STAGES = 6
ALL_STAGES = (1, 2, 3, 4, 5, 6)
TERMS = (
    *(term for term in pure.TERMS if len(term.stages) == 1),
    Term("r_boxx", (5,), True, "approach of the box to its place along world x"),
    Term("r_boxy", (5,), True, "approach of the box to its place along world y"),
    Term("r_boxz1", (5,), True, "approach of the box to the carrying height"),
    Term("r_boxz2", (6,), True, "approach of the box to the height at which it rests"),
    Term(
        "r_gripper", ALL_STAGES, True, "a penalty for closing before stage 4 and opening in 5; grasp in 4, release in 6"
    ),
    Term("r_collision_arm", ALL_STAGES, False, "the arm touches something other than the boxes"),
    Term("r_collision_self", ALL_STAGES, False, "the robot touches itself"),
    Term("r_success", ALL_STAGES, False, "bonus for a step into a later stage or to success"),
)
ACTIVE = active_terms(TERMS, N_STAGES)
SCALE = np.array([*[SCALES.distance] * 3, SCALES.angle, *[SCALES.distance] * 5])
"""Of the terms of progress, which come first."""
STATE_NAMES = (*pure.STATE_NAMES[:11], "base_x", "base_y", "base_z")
FEATURE_NAMES = (*pure.FEATURE_NAMES, "to_place_x", "to_place_y", "to_carry_z", "to_rest_z")

MANUAL_GRAPH: CausalSets = causal_sets(
    {
        1: {"r_eefx": "army", "r_eefy": "armx", "r_eefz1": "armz", "r_gripper": "grip"},
        2: {"r_ori": "armrx armry armrz", "r_gripper": "grip"},
        3: {"r_eefz2": "armz", "r_gripper": "grip"},
        4: {"r_gripper": "grip"},
        5: {"r_boxx": "army", "r_boxy": "armx", "r_boxz1": "armz", "r_gripper": "grip"},
        6: {"r_boxz2": "armz", "r_gripper": "grip"},
    }
)
"""The human's causal graph: the paper's of pure manipulation, then ours. Written down before any result."""
