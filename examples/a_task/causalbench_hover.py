"""Hover: bring the hand above the box (stage 1), then down to it (stage 2), with the three translations of the hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import (
    Capability,
    Facts,
    Layout,
    SceneSpec,
    Task,
    Term,
    Workspace,
    active_terms,
    by_name,
    causal_sets,
    hookimpl,
    pure_manipulation,
    staged_potential,
)

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of the task: all of them are part of its identity."""

    height: float = 0.10  # m above the box centre, where stage 2 ends
    tolerance_xy: float = 0.03  # m, each world axis, where stage 1 ends
    tolerance_z: float = 0.02  # m
    per_metre: float = 10.0
    bonus: float = 2.0
    expert_gain: float = 0.5  # share of the error that a control step removes


C = Constants()
TERMS = (
    Term("r_x", (1,), True, "approach of the hand to the box along world x"),
    Term("r_y", (1,), True, "approach of the hand to the box along world y"),
    Term("r_z", (2,), True, "approach of the hand to the hover height"),
    Term("r_success", (1, 2), False, "bonus for a step into stage 2 or to success"),
)
ACTIVE = active_terms(TERMS, 2)


def offset(facts: Facts) -> Array:
    """Metres (..., 3) from where the hand shall be to where it is, world axes."""
    return facts.eef_position - facts.object_position - np.array([0.0, 0.0, C.height])


def stage(facts: Facts) -> NDArray[np.int64]:
    """U(s): 2 above the box, else 1; a function of the pose alone, so that progress can reverse."""
    above = (np.abs(offset(facts)[..., :2]) < C.tolerance_xy).all(-1)
    return np.where(above, 2, 1)


def success(before: NDArray[np.int64], now: Facts) -> NDArray[np.bool_]:
    """After a step from stage 2 the hand is above the box at the hover height."""
    reached: NDArray[np.bool_] = (before == 2) & (stage(now) == 2) & (np.abs(offset(now)[..., 2]) < C.tolerance_z)
    return reached


def rewards(previous: Facts, before: NDArray[np.int64], action: Array, now: Facts, after: NDArray[np.int64]) -> Array:
    """The terms (..., 4) of a step; those of other stages than `before` are 0."""
    del action  # only what it did is paid
    approach = C.per_metre * (np.abs(offset(previous)) - np.abs(offset(now)))
    bonus = C.bonus * ((after > before) | success(before, now))
    return np.concatenate([approach, np.asarray(bonus, dtype=float)[..., None]], axis=-1) * ACTIVE[before]


def potential(state: Array, now: NDArray[np.int64]) -> Array:
    """How far along the task is, for learners that climb one reward: nothing is gained by falling back."""
    away = C.per_metre * np.abs(state)
    left = [away[..., 0] + away[..., 1], away[..., 2]]
    return staged_potential(now, left, [C.per_metre, C.per_metre], C.bonus)


def state_bounds(workspace: Workspace) -> tuple[Array, Array]:
    """Where the offset normally lies, metres."""
    del workspace  # the offset does not depend on where the table stands
    return np.full(3, -0.6), np.full(3, 0.6)


def expert(facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None) -> Array:
    """Scripted action (..., 3): proportional control of what the stage asks for."""
    del layout  # nothing is in the way
    speed = np.array([spec.action_speed[spec.actions.index(name)] for name in TASK.actions])
    yaw, error = facts.base_pose[..., 2], -offset(facts)
    ahead = np.cos(yaw) * error[..., 0] + np.sin(yaw) * error[..., 1]
    left = np.cos(yaw) * error[..., 1] - np.sin(yaw) * error[..., 0]
    first = stage(facts) == 1
    wanted = np.stack([first * ahead, first * left, ~first * error[..., 2]], axis=-1)
    return np.clip(wanted * C.expert_gain / spec.control_dt / speed, -1.0, 1.0)


def draw_layout(rng: np.random.Generator, workspace: Workspace, max_opening: float, wanted: int) -> Layout:
    """Pure manipulation's starts of its stages 1 and 2: far from the box, and above it."""
    return pure_manipulation.draw_layout(rng, workspace, max_opening, wanted)


TASK = Task(
    name="hover",
    version=0,
    env_id="hover/Hover-v0",
    n_stages=2,
    actions=("armx", "army", "armz"),
    terms=TERMS,
    state_names=("offset_x", "offset_y", "offset_z"),
    horizon=100,
    constants=by_name(C) | {"starts": pure_manipulation.TASK.constants},
    manual_graph=causal_sets({1: {"r_x": "army", "r_y": "armx"}, 2: {"r_z": "armz"}}),
    draw_layout=draw_layout,
    state_bounds=state_bounds,
    observe=offset,
    stage=stage,
    success=success,
    rewards=rewards,
    expert=expert,
    requires=frozenset[Capability](),
    potential=potential,
    potential_terms=("r_x", "r_y", "r_z", "r_success"),
)


@hookimpl
def causalbench_tasks(register: Callable[[Any], None]) -> None:
    """Tell causalbench about the task."""
    register(TASK)
