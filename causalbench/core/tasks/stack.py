"""Stacking: pick up one box and put it on another, in six stages.

1. Move the hand above the box. 2. Turn it face down. 3. Lower it. 4. Grasp. These are pure manipulation's.
5. Lift the box and carry it above the other one. 6. Lower it and let go.
U(s) is a function of poses and of what is held, so a dropped box falls back to where the hand then is. Success: after a
step from stage 6 the box lies on the other one and the fingers are clear of it; it must then stay there for a second.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.tasks import pure_manipulation as pure
from causalbench.core.tasks import pure_manipulation_data as grasping
from causalbench.core.tasks.reward_scales import HORIZON, SCALES
from causalbench.core.tasks.stack_data import (
    ACTIVE,
    FEATURE_NAMES,
    MANUAL_GRAPH,
    N_STAGES,
    SCALE,
    STATE_NAMES,
    TERMS,
    C,
)
from causalbench.core.tasks.stage_task import by_name
from causalbench.core.tasks.stages import staged_potential
from causalbench.core.tasks.task import Task
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Layout, Workspace
from causalbench.core.world.scene import Scene, SceneSpec

Array = NDArray[np.float64]

PLACE = np.array([0.0, 0.0, C.base_half_extents[2] + grasping.C.box_half_extents[2]])
"""From the middle of the lower box to that of the one that lies on it."""
WIDTH = 2 * grasping.C.box_half_extents[1]
GRASP, CARRY, PLACING = 4, 5, 6


def draw_layout(rng: np.random.Generator, workspace: Workspace, max_opening: float, stage: int) -> Layout:
    """A start inside `stage`, up to what the caller still checks: the two boxes lie on different sides of the middle.

    Always takes the same number of unit draws from `rng`. Starts of stages 5 and 6 hold the box.
    """
    unit = rng.random(8)
    side = 1.0 if unit[0] < 0.5 else -1.0
    layout = pure.draw_layout(rng, _one_side(workspace, side), max_opening, min(stage, GRASP))
    box, base = layout.target, _base(workspace, -side, unit)
    layout = dataclasses.replace(layout, others=(base,), other_masses=(C.base_mass,))
    if stage < CARRY:
        return layout
    place = base.position + PLACE
    if stage == CARRY:
        lift = unit[4] * C.highest
        share = C.on_the_way * unit[5] * (lift > C.lowest)
        goal = np.append(box.position[:2] + share * (place - box.position)[:2], box.position[2] + lift)
    else:
        aside = C.tolerance_xy * (2.0 * unit[5:7] - 1.0)
        goal = place + np.append(aside, C.rest + unit[4] * (C.carry - C.rest))
    return _held(layout, goal, C.off_centre * (2.0 * unit[7] - 1.0))


def _held(layout: Layout, goal: Array, along: float) -> Layout:
    """`layout` with the box at `goal` in the hand, which is turned as the hand is and held `along` m off its middle."""
    turn = rotations.multiply(layout.eef_quaternion, rotations.conjugate(rotations.FACE_DOWN))
    hand = goal + rotations.rotate(turn, np.array([along, 0.0, grasping.C.grasp_height]))
    return dataclasses.replace(
        layout,
        target=dataclasses.replace(layout.target, position=goal, quaternion=rotations.canonical(turn)),
        eef_position=hand,
        gripper_opening=WIDTH - C.squeezed,
    )


def _one_side(workspace: Workspace, side: float) -> Workspace:
    """`workspace` with objects on one side of the middle alone."""
    (x0, y0), (x1, y1) = workspace.object_low, workspace.object_high
    middle, half = (y0 + y1) / 2, side * (y1 - y0) / 2
    first, last = sorted((middle + C.nearest * half, middle + C.furthest * half))
    return dataclasses.replace(workspace, object_low=(x0, first), object_high=(x1, last))


def _base(workspace: Workspace, side: float, unit: Array) -> Box:
    """The lower box, somewhere on that side."""
    low, high = (np.array(bound) for bound in (workspace.object_low, workspace.object_high))
    middle, half = (low[1] + high[1]) / 2, side * (high[1] - low[1]) / 2
    y = middle + half * (C.nearest + unit[1] * (C.furthest - C.nearest))
    there = np.array([low[0] + unit[2] * (high[0] - low[0]), y, workspace.table_height + C.base_half_extents[2]])
    yaw = grasping.C.base_yaw + C.base_yaw * (2.0 * unit[3] - 1.0)
    position = rotations.rotate(grasping.BASE_QUATERNION, there)
    return Box("base", np.array(C.base_half_extents), position, rotations.from_axis_angle(2, yaw))


def offset(facts: Facts) -> Array:
    """Metres (..., 3) from the place of the box to the box, world axes."""
    return facts.object_position - facts.other_positions[..., 0, :] - PLACE


def _above(away: Array, tolerance: float) -> NDArray[np.bool_]:
    """(...) whether a box `away` (..., 3) from its place is above it, however high."""
    inside: NDArray[np.bool_] = (np.abs(away[..., :2]) < tolerance).all(-1)
    return inside


def stage(facts: Facts) -> NDArray[np.int64]:
    """U(s), int (...), 1 to 6: a memoryless function, so that progress can reverse."""
    away = offset(facts)
    low = (away[..., 2] > -C.sunk) & (away[..., 2] < np.where(facts.holding, C.carry + C.tolerance_carry, C.rest))
    placing = _above(away, C.tolerance_xy) & low
    return np.where(placing, PLACING, np.where(facts.holding, CARRY, pure.stage(facts)))


def released(facts: Facts) -> NDArray[np.bool_]:
    """(...) whether the box lies in its place and the fingers are clear of it."""
    away = offset(facts)
    there = _above(away, C.tolerance_rest) & (np.abs(away[..., 2]) < C.rest)
    clear = facts.gripper_opening > WIDTH + C.clear
    far = np.linalg.norm(facts.eef_position - facts.object_position, axis=-1) > 2 * WIDTH
    free: NDArray[np.bool_] = there & ~facts.holding & (clear | far)
    return free


def success(stage: NDArray[np.int64], now: Facts) -> NDArray[np.bool_]:
    """Bool (...): the box is released in its place after a step from stage 6; `stage` is U(s) before that step."""
    return (stage == PLACING) & released(now)


def stays(scene: Scene) -> bool:
    """Let go of everything for `C.rest_time` s; whether the box is then still in its place, and at rest."""
    count = round(C.rest_time / scene.spec.control_dt)
    seen = []
    for _ in range(count):
        scene.step(np.zeros(len(scene.spec.actions)))
        seen.append(scene.facts())
    moved = float(np.linalg.norm(seen[-1].object_position - seen[count // 2].object_position))
    return bool(released(seen[-1])) and moved < C.rest_way


def observe(facts: Facts) -> Array:
    """State variables (..., 14): those of pure manipulation that change, and the lower box, in the robot base frame."""
    base = facts.other_positions[..., 0, :]
    x, y = (base[..., axis] - facts.base_pose[..., axis] for axis in range(2))
    cos, sin = np.cos(facts.base_pose[..., 2]), np.sin(facts.base_pose[..., 2])
    seen = np.stack([cos * x + sin * y, cos * y - sin * x, base[..., 2]], axis=-1)
    return np.concatenate([pure.observe(facts)[..., :11], seen], axis=-1)


def state_bounds(workspace: Workspace) -> tuple[Array, Array]:
    """(low, high), each (14,): where the state variables normally lie."""
    low, high = pure.state_bounds(workspace)
    return np.append(low[:11], low[:3]), np.append(high[:11], high[:3])


def _to_place(state: Array) -> Array:
    """Metres (..., 3) from the box to its place, base frame."""
    return state[..., 11:14] + PLACE - state[..., 0:3]


def features(state: Array) -> Array:
    """What is left to do (..., 10), from state variables (..., 14) alone; names in `FEATURE_NAMES`."""
    way = _to_place(state)
    left = np.stack([way[..., 0], way[..., 1], way[..., 2] + C.carry, way[..., 2]], axis=-1)
    bound = grasping.C.feature_bound
    return np.concatenate([pure.features(state), np.clip(left / grasping.C.feature_distance, -bound, bound)], axis=-1)


def _tightness(facts: Facts) -> Array:
    """What the terms of progress pay for getting smaller (..., 9), in metres and radians."""
    hand, away = facts.eef_position - facts.object_position, np.abs(offset(facts))
    reach, turned = np.abs(hand), pure.tilt(facts)
    hover = np.abs(hand[..., 2] - grasping.C.hover)
    grasp = np.abs(hand[..., 2] - grasping.C.grasp_height)
    carry = np.abs(offset(facts)[..., 2] - C.carry)
    columns = [reach[..., 0], reach[..., 1], hover, turned, grasp, away[..., 0], away[..., 1], carry, away[..., 2]]
    return np.stack(columns, axis=-1)


def rewards(
    previous: Facts, stage: NDArray[np.int64], action: Array, now: Facts, next_stage: NDArray[np.int64]
) -> Array:
    """Reward vector (..., 13) of the step; terms outside `stage` = U(previous) are 0."""
    done, grip = success(stage, now), action[..., -1]
    progress = SCALE * (_tightness(previous) - _tightness(now))
    early = ((stage < GRASP) & (grip > 0.0)) | ((stage == CARRY) & (grip < 0.0))
    reached = done | ((stage == GRASP) & now.holding)
    gripper = grasping.C.early_close * early + grasping.C.grasp * reached
    bonus = SCALES.stage_bonus * ((next_stage > stage) | done)
    collisions = [SCALES.collision * flag for flag in (now.collision_arm, now.collision_self)]
    events = np.stack([gripper, *collisions, bonus], axis=-1)
    return np.concatenate([progress, events], axis=-1) * ACTIVE[stage]


def potential(state: Array, stage: NDArray[np.int64]) -> Array:
    """See `StageTask.potential`: pure manipulation's ways, and then the box's to its place."""
    left, most = pure.ways(state)
    way = np.abs(_to_place(state) + np.array([0.0, 0.0, C.carry])).sum(-1)
    rest = np.abs(_to_place(state)[..., 2])
    left = [*left, SCALES.distance * way, SCALES.distance * rest]
    most = [*most, SCALES.distance * C.farthest, SCALES.distance * (C.carry + C.tolerance_carry)]
    return staged_potential(stage, left, most, SCALES.stage_bonus)


def expert(facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None) -> Array:
    """Scripted macro action (..., 7): pure manipulation's until the grasp, then up, across, down, and open."""
    out, u = pure.expert(facts, spec, layout), stage(facts)
    speed = dict(zip(spec.actions, spec.action_speed, strict=True))
    gain, yaw, way = grasping.C.expert_gain / spec.control_dt, facts.base_pose[..., 2], -offset(facts)
    goal_z = way[..., 2] + np.where(u == CARRY, C.carry, 0.0)
    placed = (u == PLACING) & (~facts.holding | (goal_z > -C.lands))
    across = ((u == CARRY) & (way[..., 2] < -C.rises)) | ((u == PLACING) & ~placed)
    after = np.zeros_like(out)
    after[..., 0] = across * (np.cos(yaw) * way[..., 0] + np.sin(yaw) * way[..., 1]) * gain / speed["armx"]
    after[..., 1] = across * (np.cos(yaw) * way[..., 1] - np.sin(yaw) * way[..., 0]) * gain / speed["army"]
    after[..., 2] = ~placed * goal_z * gain / speed["armz"]
    after = np.clip(after, -C.careful, C.careful)
    after[..., 6] = np.where(placed, -1.0, 0.0)
    return np.where((u >= CARRY)[..., None], after, out)


TASK = Task(
    name="stack",
    version=0,
    env_id="causalbench/Stack-v0",
    n_stages=N_STAGES,
    actions=grasping.ACTIONS,
    terms=TERMS,
    state_names=STATE_NAMES,
    horizon=HORIZON,
    constants=by_name(C) | {"grasping": by_name(grasping.C), "reward_scales": by_name(SCALES)},
    manual_graph=MANUAL_GRAPH,
    draw_layout=draw_layout,
    state_bounds=state_bounds,
    observe=observe,
    stage=stage,
    rewards=rewards,
    success=success,
    expert=expert,
    requires=frozenset({Capability.SEVERAL_OBJECTS}),
    observes=frozenset({"gripper"}),
    after_success=stays,
    held_starts=frozenset({CARRY, PLACING}),
    potential=potential,
    potential_terms=(*(term.name for term in TERMS[: len(SCALE)]), "r_success"),
    features=features,
    feature_names=FEATURE_NAMES,
)
