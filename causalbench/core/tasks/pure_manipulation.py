"""Pure manipulation (paper, section Pure Manipulation Task): grasp a pencil box in four stages.

1. Move the hand above the box. 2. Turn the hand face down. 3. Lower it. 4. Close the gripper on the box.
The robot base is turned by 90 degrees, so base x drives world y and base y drives world -x.
Success: in stage 4 both fingers press on the box (`Facts.holding`), judged from the pose before the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import kernels, rotations
from causalbench.core.numerics.compiled import compiled
from causalbench.core.numerics.gufunc import broadcast
from causalbench.core.tasks import lift_and_hold as lifting
from causalbench.core.tasks.pure_manipulation_data import (
    ACTIONS,
    BASE_QUATERNION,
    FACE_DOWN,
    FEATURE_NAMES,
    MANUAL_GRAPH,
    N_STAGES,
    SCALE,
    STATE_NAMES,
    STATE_TEMPLATE,
    TERMS,
    C,
)
from causalbench.core.tasks.reward_scales import HORIZON, SCALES
from causalbench.core.tasks.stage_task import by_name
from causalbench.core.tasks.stages import staged_potential
from causalbench.core.tasks.task import Task
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Layout, Workspace
from causalbench.core.world.scene import SceneSpec

Array = NDArray[np.float64]


def draw_layout(rng: np.random.Generator, workspace: Workspace, max_opening: float, stage: int) -> Layout:
    """A start inside `stage`, up to what the caller still checks: U(s), reach and contact.

    Always takes the same number of unit draws from `rng`, mapped affinely into `workspace`, so that one
    seed means the same start in every simulator, up to the arm's reach.
    """
    unit = rng.random(10)
    spread = 2.0 * unit - 1.0
    low, high = np.array(workspace.object_low), np.array(workspace.object_high)
    box = np.append(low + unit[:2] * (high - low), workspace.table_height + C.box_half_extents[2])
    hand_low, hand_high = np.array(workspace.hand_low), np.array(workspace.hand_high)
    hand = hand_low + unit[3:6] * (hand_high - hand_low)
    pitch, roll, opening = -(C.tilt_low + unit[6] * (C.tilt_high - C.tilt_low)), C.roll * spread[7], max_opening
    if stage >= 2:
        x, y, z = C.tolerance_xy * spread[3], C.tolerance_xy * spread[4], C.hover + C.tolerance_hover * spread[5]
        hand = box + np.array([x, y, z])
    if stage == 2:
        pitch = -C.tilt_high * unit[6]
    if stage >= 3:
        pitch, roll = C.tolerance_ori * spread[6] / math.sqrt(2), C.tolerance_ori * spread[7] / math.sqrt(2)
        lowest = C.grasp_height + C.tolerance_grasp
        hand[2] = box[2] + lowest + unit[5] * (C.hover + C.tolerance_hover - lowest)
    if stage == 4:
        # Part-way through closing, the box between the pads: from wide open, random actions leave the stage long
        # before the pads meet the box, and the grasp could not be tested at all.
        slack = C.closing_slack * unit[8]
        width = 2 * (C.box_half_extents[1] + C.box_half_extents[0] * C.box_yaw * abs(spread[2]))
        opening = width + C.closing_margin * C.closing_slack + slack
        hand[1] = box[1] + spread[4] * slack / 2
        hand[2] = box[2] + C.grasp_height + C.tolerance_grasp * spread[5]
    posture = rotations.multiply(
        rotations.multiply(FACE_DOWN, rotations.from_axis_angle(1, pitch)), rotations.from_axis_angle(0, roll)
    )
    table_height = workspace.table_height
    table = np.array([workspace.object_low[0] - C.table_gap + C.table_half_extents[0], 0.0, table_height / 2])
    return Layout(
        fixtures=(
            Box("table", np.array([*C.table_half_extents, table_height / 2]), _to_world(table), BASE_QUATERNION.copy()),
        ),
        target=Box(
            "pencil_box",
            np.array(C.box_half_extents),
            _to_world(box),
            rotations.canonical(rotations.from_axis_angle(2, C.base_yaw + C.box_yaw * spread[2])),
        ),
        target_mass=C.box_mass,
        base_pose=np.array([0.0, 0.0, C.base_yaw]),
        eef_position=_to_world(hand),
        eef_quaternion=rotations.canonical(rotations.multiply(BASE_QUATERNION, posture)),
        gripper_opening=float(min(opening, max_opening)),
    )


def _to_world(point: Array) -> Array:
    return rotations.rotate(BASE_QUATERNION, point)


def state_bounds(workspace: Workspace) -> tuple[Array, Array]:
    """(low, high), each (15,): where the state variables normally lie, for scaling and for the observation space."""
    margin, table = C.bounds_margin, workspace.table_height
    box_low = np.array([*workspace.object_low, table])
    box_high = np.array([*workspace.object_high, table + C.bounds_rise])
    hand_low = np.minimum([*workspace.hand_low[:2], table], box_low)
    hand_high = np.maximum(workspace.hand_high, [*workspace.object_high, table + C.hover])
    side = np.array([margin, margin, 0.0])
    top = np.array([margin, margin, margin])
    low = [*(box_low - side), *(hand_low - side), table, *[-1.0] * 8]
    high = [*(box_high + side), *(hand_high + top), table + C.bounds_rise + C.hover, *[1.0] * 8]
    return np.array(low), np.array(high)


def observe(facts: Facts) -> Array:
    """State variables (..., 15) of the paper's appendix, in the robot base frame; names in `STATE_NAMES`."""
    return _observe(facts.eef_position, facts.eef_quaternion, facts.object_position, facts.base_pose, STATE_TEMPLATE)


@broadcast("f8[:], f8[:], f8[:], f8[:], f8[:], f8[:]", "(p),(q),(p),(b),(s)->(s)")
def _observe(hand: Array, posture: Array, box: Array, base: Array, template: Array, out: Array) -> None:
    out[:] = template
    cos, sin = math.cos(base[2]), math.sin(base[2])
    for column, point in ((0, box), (3, hand)):
        x, y = point[0] - base[0], point[1] - base[1]
        out[column] = cos * x + sin * y
        out[column + 1] = cos * y - sin * x
        out[column + 2] = point[2]
    out[6] = box[2] + C.hover
    kernels.unturned(base[2], posture, out[7:11])
    if out[9] < 0.0:  # the sign that is nearest to the target: with w >= 0 the posture would jump at the target itself
        out[7:11] *= -1.0


def features(state: Array) -> Array:
    """What is left to do (..., 6), computed from state variables (..., 15) alone; names in `FEATURE_NAMES`.

    The way of the hand to the box, and up to the hover and the grasp height above it, in the base frame, and the
    rotation vector that turns the hand straight down, in the hand's own frame, whose third number is 0.
    """
    return _features(state, FEATURE_TEMPLATE)


FEATURE_TEMPLATE = np.zeros(len(FEATURE_NAMES))


@broadcast("f8[:], f8[:], f8[:]", "(s),(f)->(f)")
def _features(state: Array, template: Array, out: Array) -> None:
    out[:] = template
    for axis in range(3):
        out[axis] = (state[axis] - state[3 + axis]) / C.feature_distance
    out[3] = out[2] + C.grasp_height / C.feature_distance
    out[2] += C.hover / C.feature_distance
    w, x, y, z = state[7], state[8], state[9], state[10]
    # Straight down seen from the hand; the shortest turn of its z axis there is about z x down.
    down_x, down_y, down_z = 2.0 * (w * y - x * z), -2.0 * (y * z + w * x), 2.0 * (x * x + y * y) - 1.0
    sine = math.hypot(down_x, down_y)
    ratio = math.atan2(sine, down_z) / max(sine, 1e-9) / C.feature_angle
    out[4], out[5] = -down_y * ratio, down_x * ratio
    for column in range(6):
        out[column] = min(max(out[column], -C.feature_bound), C.feature_bound)


def tilt(facts: Facts) -> Array:
    """Angle (...) in radians between the approach axis and straight down."""
    return _tilt(facts.eef_quaternion)


@compiled
def _angle(posture: Array) -> float:
    return math.acos(min(2.0 * (posture[1] ** 2 + posture[2] ** 2) - 1.0, 1.0))


@broadcast("f8[:], f8[:]", "(q)->()")
def _tilt(posture: Array, out: Array) -> None:
    out[0] = _angle(posture)


def stage(facts: Facts) -> NDArray[np.int64]:
    """U(s), int (...), 1 to 4: a memoryless function of the relative pose, so that progress can reverse."""
    return _stage(facts.eef_position, facts.eef_quaternion, facts.object_position)


@broadcast("f8[:], f8[:], f8[:], i8[:]", "(p),(q),(p)->()")
def _stage(hand: Array, posture: Array, box: Array, out: Array) -> None:
    x, y, z = hand[0] - box[0], hand[1] - box[1], hand[2] - box[2]
    out[0] = 1
    if abs(x) < C.tolerance_xy and abs(y) < C.tolerance_xy:
        if abs(z - C.hover) < C.tolerance_hover:
            out[0] = 2
        if _angle(posture) < C.tolerance_ori and C.grasp_height - C.tolerance_grasp < z < C.hover + C.tolerance_hover:
            out[0] = 4 if abs(z - C.grasp_height) < C.tolerance_grasp else 3


def success(stage: NDArray[np.int64], now: Facts) -> NDArray[np.bool_]:
    """Bool (...): the box is held after a step from stage 4; `stage` is U(s) before the motion of that step."""
    return (stage == 4) & now.holding


def rewards(
    previous: Facts, stage: NDArray[np.int64], action: Array, now: Facts, next_stage: NDArray[np.int64]
) -> Array:
    """Reward vector (..., 9) of the step; terms outside `stage` = U(previous) are 0 (paper, Reward Setting)."""
    return scaled_rewards(previous, stage, action, now, next_stage, SCALE[stage])


def scaled_rewards(
    previous: Facts, stage: NDArray[np.int64], action: Array, now: Facts, next_stage: NDArray[np.int64], scale: Array
) -> Array:
    """As `rewards`, each term multiplied by its `scale` (..., 9), 0 for those that are not paid."""
    return _rewards(
        previous.eef_position,
        previous.eef_quaternion,
        previous.object_position,
        now.eef_position,
        now.eef_quaternion,
        now.object_position,
        stage,
        next_stage,
        action,
        now.holding,
        now.collision_arm,
        now.collision_self,
        scale,
    )


@broadcast(
    "f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], i8, i8, f8[:], b1, b1, b1, f8[:], f8[:]",
    "(p),(q),(p),(p),(q),(p),(),(),(k),(),(),(),(t)->(t)",
)
def _rewards(
    hand: Array, posture: Array, box: Array, next_hand: Array, next_posture: Array, next_box: Array, stage: int,
    next_stage: int, action: Array, holding: bool, collision_arm: bool, collision_self: bool, scale: Array, out: Array,
) -> None:  # fmt: skip
    done = stage == 4 and holding
    height, next_height = hand[2] - box[2], next_hand[2] - next_box[2]
    out[0] = abs(hand[0] - box[0]) - abs(next_hand[0] - next_box[0])
    out[1] = abs(hand[1] - box[1]) - abs(next_hand[1] - next_box[1])
    out[2] = abs(height - C.hover) - abs(next_height - C.hover)
    out[3] = _angle(posture) - _angle(next_posture)
    out[4] = abs(height - C.grasp_height) - abs(next_height - C.grasp_height)
    out[5] = C.grasp if done else C.early_close if stage < 4 and action[6] > 0.0 else 0.0
    out[6] = -1.0 if collision_arm else 0.0
    out[7] = -1.0 if collision_self else 0.0
    out[8] = 1.0 if next_stage > stage or done else 0.0
    for term in range(9):
        out[term] = scale[term] * out[term] if scale[term] > 0.0 else 0.0


def potential(state: Array, stage: NDArray[np.int64]) -> Array:
    """See `StageTask.potential`: the hand's distances and tilt, each in its stage, at the scales of the terms."""
    return staged_potential(stage, *ways(state), SCALES.stage_bonus)


def ways(state: Array) -> tuple[list[Array], list[float]]:
    """By stage, what its terms would still pay until its end, of states (..., n), and what they pay at most."""
    x, y, z = (state[..., axis] - state[..., 3 + axis] for axis in range(3))
    away = np.abs(x) + np.abs(y) + np.abs(z + C.hover)
    askew = np.arccos(np.clip(2.0 * (state[..., 8] ** 2 + state[..., 9] ** 2) - 1.0, -1.0, 1.0))
    above = np.abs(z + C.grasp_height)
    left = [SCALES.distance * away, SCALES.angle * askew, SCALES.distance * above, np.zeros_like(above)]
    highest = C.hover + C.tolerance_hover
    most = [SCALES.distance * C.farthest, SCALES.angle * math.pi, SCALES.distance * highest, 0.0]
    return left, most


def expert(facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None) -> Array:
    """Scripted macro action (..., 7): proportional control of what the stage asks for and nothing else."""
    del layout  # nothing is in the way
    return act(facts, spec, stage(facts))


def act(facts: Facts, spec: SceneSpec, u: NDArray[np.int64]) -> Array:
    """As `expert`, the stage being `u`, int (...)."""
    speed = dict(zip(spec.actions, spec.action_speed, strict=True))
    gain = C.expert_gain / spec.control_dt
    yaw = facts.base_pose[..., 2]
    error = facts.object_position - facts.eef_position
    goal_z = error[..., 2] + np.where(u >= 3, C.grasp_height, C.hover)
    out = np.zeros((*error.shape[:-1], 7))
    moving, turning = u == 1, u == 2
    out[..., 0] = moving * (np.cos(yaw) * error[..., 0] + np.sin(yaw) * error[..., 1]) * gain / speed["armx"]
    out[..., 1] = moving * (np.cos(yaw) * error[..., 1] - np.sin(yaw) * error[..., 0]) * gain / speed["army"]
    out[..., 2] = (moving | (u == 3)) * goal_z * gain / speed["armz"]
    # Straight down seen from the hand: turning about z x down moves the approach axis there without any rz.
    down = rotations.rotate(rotations.conjugate(facts.eef_quaternion), np.array([0.0, 0.0, -1.0]))
    angle = tilt(facts)
    ratio = angle / np.maximum(np.sin(angle), 1e-9)
    out[..., 3] = turning * -down[..., 1] * ratio * gain / speed["armrx"]
    out[..., 4] = turning * down[..., 0] * ratio * gain / speed["armry"]
    out[..., 6] = np.where(u == 4, 1.0, -1.0)
    return np.clip(out, -1.0, 1.0)


TASK = Task(
    name="pure_manipulation",
    version=0,
    env_id="causalbench/PureManipulation-v0",
    n_stages=N_STAGES,
    actions=ACTIONS,
    terms=TERMS,
    state_names=STATE_NAMES,
    horizon=HORIZON,
    constants=by_name(C) | {"reward_scales": by_name(SCALES), "lift_and_hold": by_name(lifting.C)},
    manual_graph=MANUAL_GRAPH,
    draw_layout=draw_layout,
    state_bounds=state_bounds,
    observe=observe,
    stage=stage,
    rewards=rewards,
    success=success,
    expert=expert,
    paper_sensor="rgb",
    observes=frozenset({"gripper"}),
    after_success=lifting.lift_and_hold,
    potential=potential,
    potential_terms=("r_eefx", "r_eefy", "r_eefz1", "r_ori", "r_eefz2", "r_success"),
    features=features,
    feature_names=FEATURE_NAMES,
)
