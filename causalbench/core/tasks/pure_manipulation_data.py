"""Names and numbers of pure manipulation: constants, actions, reward terms, state variables, the human's graph."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from causalbench.core.numerics import rotations
from causalbench.core.tasks.reward_scales import SCALES
from causalbench.core.tasks.stage_task import CausalSets, Term, causal_sets
from causalbench.core.tasks.stages import active_terms


class Constants(NamedTuple):
    """Every number of the task, part of its identity; metres, radians and kilograms."""

    box_half_extents: tuple[float, float, float] = (0.05, 0.015, 0.025)  # the short side is y
    box_mass: float = 0.2
    table_half_extents: tuple[float, float] = (0.3, 0.5)  # along base x and y
    table_gap: float = 0.1  # from the nearest object start to the table's near edge
    base_yaw: float = math.pi / 2
    box_yaw: float = 0.1  # either way
    tilt_low: float = 0.5  # by which a starting hand points forward of straight down
    tilt_high: float = 0.85
    roll: float = 0.3  # either way about the hand's own x axis
    closing_slack: float = 0.02  # at most so much wider than the box is the gripper at a start inside stage 4
    closing_margin: float = 0.1  # share of that slack by which it is wider at least
    bounds_margin: float = 0.1  # beyond where starts lie, in the bounds of what is observed
    bounds_rise: float = 0.3  # of the box above the table, there
    hover: float = 0.15  # above the box centre: where stage 1 ends
    grasp_height: float = 0.012  # above the box centre: where stage 3 ends; no fingertip meets the table
    tolerance_xy: float = 0.02  # each world axis
    tolerance_hover: float = 0.02
    tolerance_ori: float = 0.10  # between the approach axis and straight down
    tolerance_grasp: float = 0.012
    early_close: float = -0.5  # reward
    grasp: float = 5.0  # reward
    farthest: float = 1.5  # of the hand from the hover point, summed over the axes, from where on the potential is 0
    feature_distance: float = 0.1  # of the hand from where it is to be, that makes a feature 1
    feature_angle: float = 0.3  # of the hand from straight down, likewise
    feature_bound: float = 3.0  # beyond which a feature is clipped
    expert_gain: float = 0.5  # share of an error that the expert removes in a control step


C = Constants()

ACTIONS = ("armx", "army", "armz", "armrx", "armry", "armrz", "grip")
N_STAGES = 4
ALL_STAGES = (1, 2, 3, 4)
TERMS = (
    Term("r_eefx", (1,), True, "approach of the hand to the box along world x"),
    Term("r_eefy", (1,), True, "approach of the hand to the box along world y"),
    Term("r_eefz1", (1,), True, "approach of the hand to the hover height"),
    Term("r_ori", (2,), True, "turn of the approach axis towards straight down"),
    Term("r_eefz2", (3,), True, "approach of the hand to the grasp height"),
    Term("r_gripper", ALL_STAGES, True, "closing: a penalty before stage 4, the grasp in stage 4"),
    Term("r_collision_arm", ALL_STAGES, False, "the arm touches something other than the box"),
    Term("r_collision_self", ALL_STAGES, False, "the robot touches itself"),
    Term("r_success", ALL_STAGES, False, "bonus for a step into a later stage or to success"),
)
# By stage and term, 0 where the term is not active.
SCALE = active_terms(TERMS, N_STAGES) * np.array(
    [*[SCALES.distance] * 3, SCALES.angle, SCALES.distance, 1.0, *[-SCALES.collision] * 2, SCALES.stage_bonus]
)
STATE_NAMES = (
    *("pencil_box_x", "pencil_box_y", "pencil_box_z", "eefx", "eefy", "eefz", "target_eeflz"),
    *("ori1", "ori2", "ori3", "ori4", "target_ori1", "target_ori2", "target_ori3", "target_ori4"),
)
FEATURE_NAMES = ("to_box_x", "to_box_y", "to_hover_z", "to_grasp_z", "to_down_x", "to_down_y")

BASE_QUATERNION = np.array([math.cos(C.base_yaw / 2), 0.0, 0.0, math.sin(C.base_yaw / 2)])
FACE_DOWN = rotations.FACE_DOWN
"""Target posture in the base frame."""
STATE_TEMPLATE = np.concatenate([np.zeros(11), FACE_DOWN])

MANUAL_GRAPH: CausalSets = causal_sets(
    {
        1: {"r_eefx": "army", "r_eefy": "armx", "r_eefz1": "armz", "r_gripper": "grip"},
        2: {"r_ori": "armrx armry armrz", "r_gripper": "grip"},
        3: {"r_eefz2": "armz", "r_gripper": "grip"},
        4: {"r_gripper": "grip"},
    }
)
"""The human's causal graph (paper, figure Manual Causal Graph)."""
