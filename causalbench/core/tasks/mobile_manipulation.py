"""Mobile manipulation (paper, section Mobile Manipulation Task): bring the hand to a point in a living room.

1. Drive until the target is near. 2. Turn to face it. 3. Move the hand into it.
The target is a mark in space above ground on which the robot can stand and turn, so that it can be reached from
whichever side the robot comes. Success: after a step from stage 3 the hand is inside the target.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.numerics.compiled import compiled
from causalbench.core.numerics.gufunc import broadcast
from causalbench.core.tasks import rooms
from causalbench.core.tasks.reward_scales import HORIZON, SCALES
from causalbench.core.tasks.stage_task import CausalSets, Term, by_name, causal_sets
from causalbench.core.tasks.stages import active_terms, staged_potential
from causalbench.core.tasks.task import Task
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Carry, Layout, Workspace
from causalbench.core.world.scene import SceneSpec
from causalbench.errors import UserError

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of the task beside those of its rooms, part of its identity; metres, radians and seconds."""

    target_low: float = 0.60  # above the floor
    target_high: float = 0.85
    start_gap: float = 0.5  # so much further than near is the target at a start of stage 1
    near_depth: float = 0.15  # so much nearer than need be the base may be at a start of stages 2 and 3
    near: float = 0.80  # from the base's axis of turning to the target, horizontally: where stage 1 ends
    tolerance_theta: float = 0.10  # between straight ahead and the target: where stage 2 ends
    target_radius: float = 0.05  # about the target: where stage 3 ends
    max_forward: float = 1.0  # m/s, bound of the observed speed
    max_turn: float = 2.0  # rad/s, likewise
    bounds_margin: float = 0.2  # beyond where the hand starts and works, in the bounds of what is observed
    reverse: float = 0.2  # share of the speed at which the base drives backwards
    feature_distance: float = 0.2  # of the hand from the target, that makes a feature 1
    expert_gain: float = 0.5  # share of an error that the expert removes in a control step
    expert_ahead: int = 4  # cells of the ground that the expert looks ahead
    expert_narrowness: int = 8  # power of the bearing's cosine, which is how fast the expert drives


C = Constants()

ACTIONS = ("forward", "turn", "armx", "army", "armz")
N_STAGES = 3
ALL_STAGES = (1, 2, 3)
TERMS = (
    Term("r_rho", (1,), True, "approach of the base to the target, horizontally"),
    Term("r_theta", (2,), True, "turn of the base towards the target"),
    Term("r_eefx", (3,), True, "approach of the hand to the target along world x"),
    Term("r_eefy", (3,), True, "approach of the hand to the target along world y"),
    Term("r_eefz", (3,), True, "approach of the hand to the target along world z"),
    Term("r_collision_base", ALL_STAGES, False, "the base touches something"),
    Term("r_collision_arm", ALL_STAGES, False, "the arm touches something"),
    Term("r_collision_self", ALL_STAGES, False, "the robot touches itself"),
    Term("r_success", ALL_STAGES, False, "bonus for a step into a later stage or to success"),
)
# By stage and term, 0 where the term is not active.
SCALE = active_terms(TERMS, N_STAGES) * np.array(
    [SCALES.distance, SCALES.angle, *[SCALES.distance] * 3, *[-SCALES.collision] * 3, SCALES.stage_bonus]
)
STATE_NAMES = ("rho", "theta", "height", "v_forward", "v_turn", "eeflx", "eefly", "eeflz")
FEATURE_NAMES = ("cos_theta", "sin_theta", "to_target_x", "to_target_y", "to_target_z")

MANUAL_GRAPH: CausalSets = causal_sets(
    {
        1: {"r_rho": "forward turn"},
        2: {"r_theta": "turn"},
        3: {"r_eefx": "armx army", "r_eefy": "armx army", "r_eefz": "armz"},
    }
)
"""The human's causal graph: ours, for the paper gives none. Written down before any result."""


def _carry(workspace: Workspace) -> Carry:
    if workspace.carry is None:
        raise UserError("mobile manipulation needs a robot that drives: the workspace declares no `carry`")
    return workspace.carry


def draw_layout(rng: np.random.Generator, workspace: Workspace, max_opening: float, stage: int) -> Layout:
    """A start inside `stage`, up to what the caller still checks: U(s), reach and contact.

    Always takes the same number of unit draws from `rng`. Base and target stand on free cells of the room's ground, so
    that a way between them exists and the robot starts clear of everything, whichever way it faces.
    """
    unit = rng.random(12)
    carry = _carry(workspace)
    boxes = rooms.fixtures(_pick(unit[0], rooms.N_PLANS))
    ground = rooms.ground(boxes, carry.footprint)
    cells = ground.centres[ground.free]
    target = cells[_pick(unit[1], len(cells))] + rooms.CELL * (unit[2:4] - 0.5)
    height = C.target_low + unit[4] * (C.target_high - C.target_low)
    away = np.hypot(*(cells - target).T)
    cells = cells[away > C.near + C.start_gap if stage == 1 else (away < C.near) & (away > C.near - C.near_depth)]
    base = cells[_pick(unit[5], len(cells))] + rooms.CELL * (unit[6:8] - 0.5)
    bearing = math.atan2(*(target - base)[::-1])
    yaw = math.remainder(bearing + (2 * unit[8] - 1) * (C.tolerance_theta if stage == 3 else math.pi), math.tau)
    low, high = np.array(carry.hand_low), np.array(carry.hand_high)
    turn = rotations.from_axis_angle(2, yaw)
    hand = rotations.rotate(turn, low + unit[9:12] * (high - low)) + np.append(base, 0.0)
    posture = rotations.multiply(rotations.FACE_DOWN, rotations.from_axis_angle(1, -carry.tilt))
    return Layout(
        fixtures=boxes,
        target=Box("target", np.full(3, C.target_radius), np.append(target, height), np.array([1.0, 0.0, 0.0, 0.0])),
        target_mass=0.0,
        base_pose=np.append(base, yaw),
        eef_position=hand,
        eef_quaternion=rotations.canonical(rotations.multiply(turn, posture)),
        gripper_opening=max_opening,
    )


def _pick(unit: float, n: int) -> int:
    return min(int(unit * n), n - 1)


def state_bounds(workspace: Workspace) -> tuple[Array, Array]:
    """(low, high), each (8,): where the state variables normally lie, for scaling and for the observation space."""
    carry, margin = _carry(workspace), C.bounds_margin
    furthest = 2 * math.hypot(*rooms.ROOM_HALF_EXTENTS)
    hand_low = np.minimum(carry.hand_low, [0.0, -C.near * C.tolerance_theta, C.target_low]) - margin
    hand_high = np.maximum(carry.hand_high, [C.near, C.near * C.tolerance_theta, C.target_high]) + margin
    low = [0.0, -math.pi, C.target_low, -C.max_forward, -C.max_turn, *hand_low]
    high = [furthest, math.pi, C.target_high, C.max_forward, C.max_turn, *hand_high]
    return np.array(low), np.array(high)


@compiled
def _rho(base: Array, target: Array) -> float:
    return math.hypot(target[0] - base[0], target[1] - base[1])


@compiled
def _theta(base: Array, target: Array) -> float:
    angle = math.atan2(target[1] - base[1], target[0] - base[0]) - base[2]
    return (angle + math.pi) % (2 * math.pi) - math.pi


def observe(facts: Facts) -> Array:
    """State variables (..., 8) of the paper's appendix, in the robot base frame; names in `STATE_NAMES`."""
    out: Array = _observe(facts.base_pose, facts.base_velocity, facts.eef_position, facts.object_position, LIKE_STATE)
    return out


LIKE_STATE = np.zeros(len(STATE_NAMES))


@broadcast("f8[:], f8[:], f8[:], f8[:], f8[:], f8[:]", "(b),(v),(p),(p),(s)->(s)")
def _observe(base: Array, velocity: Array, hand: Array, target: Array, like: Array, out: Array) -> None:
    out[0], out[1], out[2] = _rho(base, target), _theta(base, target), target[2]
    out[3], out[4] = velocity[0], velocity[1]
    cos, sin = math.cos(base[2]), math.sin(base[2])
    x, y = hand[0] - base[0], hand[1] - base[1]
    out[5], out[6], out[7] = cos * x + sin * y, cos * y - sin * x, hand[2]


def features(state: Array) -> Array:
    """The bearing without its jump and the way of the hand to the target (..., 5), from state variables (..., 8) alone.

    In the base frame; names in `FEATURE_NAMES`.
    """
    out: Array = _features(state, LIKE_FEATURES)
    return out


LIKE_FEATURES = np.zeros(len(FEATURE_NAMES))


@broadcast("f8[:], f8[:], f8[:]", "(s),(f)->(f)")
def _features(state: Array, like: Array, out: Array) -> None:
    out[:] = like
    rho, cos, sin = state[0], math.cos(state[1]), math.sin(state[1])
    out[0], out[1] = cos, sin
    out[2] = (rho * cos - state[5]) / C.feature_distance
    out[3] = (rho * sin - state[6]) / C.feature_distance
    out[4] = (state[2] - state[7]) / C.feature_distance


def stage(facts: Facts) -> NDArray[np.int64]:
    """U(s), int (...), 1 to 3: a memoryless function of where the base is, so that progress can reverse."""
    out: NDArray[np.int64] = _stage(facts.base_pose, facts.object_position)
    return out


@broadcast("f8[:], f8[:], i8[:]", "(b),(p)->()")
def _stage(base: Array, target: Array, out: Array) -> None:
    out[0] = 1
    if _rho(base, target) < C.near:
        out[0] = 3 if abs(_theta(base, target)) < C.tolerance_theta else 2


def success(stage: NDArray[np.int64], now: Facts) -> NDArray[np.bool_]:
    """Bool (...): the hand is inside the target after a step from stage 3; `stage` is U(s) before that step."""
    inside: NDArray[np.bool_] = _inside(now.eef_position, now.object_position)
    return (stage == 3) & inside


@compiled
def _is_inside(hand: Array, target: Array) -> bool:
    x, y, z = hand[0] - target[0], hand[1] - target[1], hand[2] - target[2]
    return x * x + y * y + z * z < C.target_radius * C.target_radius


@broadcast("f8[:], f8[:], b1[:]", "(p),(p)->()")
def _inside(hand: Array, target: Array, out: Array) -> None:
    out[0] = _is_inside(hand, target)


def rewards(
    previous: Facts, stage: NDArray[np.int64], action: Array, now: Facts, next_stage: NDArray[np.int64]
) -> Array:
    """Reward vector (..., 9) of the step; terms outside `stage` = U(previous) are 0 (paper, Reward Setting)."""
    del action  # only what it did to the state is paid
    out: Array = _rewards(
        previous.base_pose,
        previous.eef_position,
        previous.object_position,
        now.base_pose,
        now.eef_position,
        now.object_position,
        stage,
        next_stage,
        now.collision_base,
        now.collision_arm,
        now.collision_self,
        SCALE[stage],
    )
    return out


@broadcast(
    "f8[:], f8[:], f8[:], f8[:], f8[:], f8[:], i8, i8, b1, b1, b1, f8[:], f8[:]",
    "(b),(p),(p),(b),(p),(p),(),(),(),(),(),(t)->(t)",
)
def _rewards(
    base: Array, hand: Array, target: Array, next_base: Array, next_hand: Array, next_target: Array, stage: int,
    next_stage: int, collision_base: bool, collision_arm: bool, collision_self: bool, scale: Array, out: Array,
) -> None:  # fmt: skip
    done = stage == 3 and _is_inside(next_hand, next_target)
    out[0] = _rho(base, target) - _rho(next_base, next_target)
    out[1] = abs(_theta(base, target)) - abs(_theta(next_base, next_target))
    for axis in range(3):
        out[2 + axis] = abs(hand[axis] - target[axis]) - abs(next_hand[axis] - next_target[axis])
    out[5] = -1.0 if collision_base else 0.0
    out[6] = -1.0 if collision_arm else 0.0
    out[7] = -1.0 if collision_self else 0.0
    out[8] = 1.0 if next_stage > stage or done else 0.0
    for term in range(9):
        out[term] = scale[term] * out[term] if scale[term] > 0.0 else 0.0


def potential(state: Array, stage: NDArray[np.int64]) -> Array:
    """See `StageTask.potential`: distance, bearing and the hand's error, each in its stage, at the terms' scales."""
    rho, theta = state[..., 0], state[..., 1]
    ahead, aside = rho * np.cos(theta) - state[..., 5], rho * np.sin(theta) - state[..., 6]
    error = np.abs(ahead) + np.abs(aside) + np.abs(state[..., 2] - state[..., 7])
    beyond = np.maximum(rho - C.near, 0.0)
    left = [SCALES.distance * beyond, SCALES.angle * np.abs(theta), SCALES.distance * error]
    furthest = 2 * math.hypot(*rooms.ROOM_HALF_EXTENTS)
    most = [SCALES.distance * (furthest - C.near), SCALES.angle * math.pi, SCALES.distance * 3 * C.near]
    return staged_potential(stage, left, most, SCALES.stage_bonus)


def expert(facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None) -> Array:
    """Scripted macro action (..., 5): what the stage asks for and nothing else.

    With a `layout` it drives along the shortest way over the room's free ground, else straight on.
    """
    speed = dict(zip(spec.actions, spec.action_speed, strict=True))
    gain = C.expert_gain / spec.control_dt
    u, error = stage(facts), facts.object_position - facts.eef_position
    base = facts.base_pose
    goal = facts.object_position[..., :2]
    if layout is not None:
        layouts = [layout] if isinstance(layout, Layout) else layout
        goal = goal.copy()
        for room, stage_of, start, end in zip(
            layouts, np.atleast_1d(u), np.atleast_2d(base), np.atleast_2d(goal), strict=True
        ):
            if stage_of == 1:
                ground = rooms.ground(room.fixtures, _carry(spec.workspace).footprint)
                end[:] = ground.waypoint(start[:2], end, C.expert_ahead)
    way = goal - base[..., :2]
    bearing = np.arctan2(way[..., 1], way[..., 0]) - base[..., 2]
    bearing = (bearing + math.pi) % math.tau - math.pi
    yaw = base[..., 2]
    out = np.zeros((*error.shape[:-1], len(ACTIONS)))
    out[..., 0] = (u == 1) * np.maximum(np.cos(bearing), 0.0) ** C.expert_narrowness
    out[..., 1] = (u <= 2) * bearing * gain / speed["turn"]
    out[..., 2] = (u == 3) * (np.cos(yaw) * error[..., 0] + np.sin(yaw) * error[..., 1]) * gain / speed["armx"]
    out[..., 3] = (u == 3) * (np.cos(yaw) * error[..., 1] - np.sin(yaw) * error[..., 0]) * gain / speed["army"]
    out[..., 4] = (u == 3) * error[..., 2] * gain / speed["armz"]
    return np.clip(out, -1.0, 1.0)


TASK = Task(
    name="mobile_manipulation",
    version=1,
    env_id="causalbench/MobileManipulation-v1",
    n_stages=N_STAGES,
    actions=ACTIONS,
    terms=TERMS,
    state_names=STATE_NAMES,
    horizon=HORIZON,
    constants=by_name(C) | {"reward_scales": by_name(SCALES), "rooms": rooms.CONSTANTS},
    manual_graph=MANUAL_GRAPH,
    draw_layout=draw_layout,
    state_bounds=state_bounds,
    observe=observe,
    stage=stage,
    rewards=rewards,
    success=success,
    expert=expert,
    requires=frozenset({Capability.MOBILE_BASE, Capability.LIDAR}),
    scene_options={"mobile": True},
    camera="room",
    observes=frozenset({"lidar"}),
    paper_sensor="lidar",
    potential=potential,
    potential_terms=("r_rho", "r_theta", "r_eefx", "r_eefy", "r_eefz", "r_success"),
    features=features,
    feature_names=FEATURE_NAMES,
    reverse_share={"forward": C.reverse},
)
