"""Changed scenes: the same task on another table, with another box, with worse sensors, or among distractors.

Every function takes a task and a number, and gives the changed task. What is random in them (noise, chance) is a hash
of the state: another state, another number, and the same one from a restored snapshot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.tasks.changes.changed_task import as_changed
from causalbench.core.tasks.stage_task import Term
from causalbench.core.tasks.task import Expert, Task
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Layout, Workspace
from causalbench.core.world.scene import SceneSpec
from causalbench.errors import UserError

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator, Workspace, float, int], Layout]

GRAIN = 1e-5  # of a state variable: states nearer to one another have the same noise
DISTRACTION = 0.1  # what a distractor pays, as standard deviation or per metre


def table_height(task: Task, rise: float) -> Task:
    """The table, and with it hand and box at the start, stand higher by `rise` metres."""
    return _in_workspace(task, partial(_risen, rise=rise))


def near_limit(task: Task, further: float) -> Task:
    """Table and box stand `further` metres further from the base, nearer to the limit of the arm."""
    return _in_workspace(task, partial(_shifted, further=further))


def base_yaw(task: Task, turn: float) -> Task:
    """Robot and table are turned by `turn` radians, so that the arm's axes are not those of the rewards."""
    return _in_layout(task, partial(_turned, turn=turn))


def box_size(task: Task, factor: float) -> Task:
    """The target is `factor` times as large."""
    return _in_layout(task, partial(_resized, factor=_positive("box_size", factor)))


def box_mass(task: Task, factor: float) -> Task:
    """The target weighs `factor` times as much."""
    return _in_layout(task, partial(_weighed, factor=_positive("box_mass", factor)))


def sensor_noise(task: Task, size: float) -> Task:
    """Every state variable is off by chance, with a standard deviation of `size`."""
    return dataclasses.replace(task, observe=partial(_sensed, observe=task.observe, size=size))


def action_lag(task: Task, steps: float) -> Task:
    """Every action is executed one control step late. Raises `UserError` for another number of steps."""
    if steps != 1:
        raise UserError(f"action_lag={steps:g}: expected 1, the control steps that actions are late by")
    return dataclasses.replace(as_changed(task), lag=True)


def distractors(task: Task, times: float) -> Task:
    """`times` as many actions and terms more as the task has; the actions do nothing, and nothing causes the terms.

    Half of the terms pay by chance, half for where the hand is before the step.
    """
    n_actions, known = int(times * len(task.actions)), [t for t in task.terms if t.discoverable]
    stages = tuple(range(1, task.n_stages + 1))
    idle = tuple(f"nothing_{i}" for i in range(1, n_actions + 1))
    terms = tuple(
        Term(f"r_nothing_{i}", stages, True, "chance" if i % 2 else "where the hand is before the step")
        for i in range(1, int(times * len(known)) + 1)
    )
    none = {term.name: frozenset[str]() for term in terms}
    return dataclasses.replace(
        as_changed(task),
        actions=(*task.actions, *idle),
        terms=(*task.terms, *terms),
        manual_graph={stage: {**row, **none} for stage, row in task.manual_graph.items()},
        rewards=partial(_distracted, rewards=task.rewards, n_actions=len(task.actions), n_terms=len(terms)),
        expert=partial(_idle_expert, expert=task.expert, idle=n_actions),
        idle=n_actions,
    )


SCENES: dict[str, Callable[[Task, float], Task]] = {
    function.__name__: function
    for function in (table_height, near_limit, base_yaw, box_size, box_mass, sensor_noise, action_lag, distractors)
}
"""What stands before the number in `NAME+CHANGE=NUMBER` -> what it does."""


def _positive(name: str, factor: float) -> float:
    if factor <= 0.0:
        raise UserError(f"{name}={factor:g}: expected a factor above 0")
    return factor


def _in_layout(task: Task, change: Callable[[Layout, float], Layout]) -> Task:
    return dataclasses.replace(task, draw_layout=partial(_draw, draw=task.draw_layout, change=change))


def _in_workspace(task: Task, change: Callable[[Workspace], Workspace]) -> Task:
    return dataclasses.replace(
        task,
        draw_layout=partial(_draw_in, draw=task.draw_layout, change=change),
        state_bounds=partial(_bounds_in, bounds=task.state_bounds, change=change),
    )


def _draw_in(
    rng: np.random.Generator,
    workspace: Workspace,
    max_opening: float,
    stage: int,
    *,
    draw: Draw,
    change: Callable[[Workspace], Workspace],
) -> Layout:
    return draw(rng, change(workspace), max_opening, stage)


def _bounds_in(
    workspace: Workspace,
    *,
    bounds: Callable[[Workspace], tuple[Array, Array]],
    change: Callable[[Workspace], Workspace],
) -> tuple[Array, Array]:
    return bounds(change(workspace))


def _risen(workspace: Workspace, rise: float) -> Workspace:
    (x0, y0, low), (x1, y1, high) = workspace.hand_low, workspace.hand_high
    return dataclasses.replace(
        workspace,
        table_height=workspace.table_height + rise,
        hand_low=(x0, y0, low + rise),
        hand_high=(x1, y1, high + rise),
    )


def _shifted(workspace: Workspace, further: float) -> Workspace:
    (x0, y0), (x1, y1) = workspace.object_low, workspace.object_high
    return dataclasses.replace(workspace, object_low=(x0 + further, y0), object_high=(x1 + further, y1))


def _draw(
    rng: np.random.Generator,
    workspace: Workspace,
    max_opening: float,
    stage: int,
    *,
    draw: Draw,
    change: Callable[[Layout, float], Layout],
) -> Layout:
    return change(draw(rng, workspace, max_opening, stage), max_opening)


def _turned(layout: Layout, max_opening: float, *, turn: float) -> Layout:
    about = rotations.from_axis_angle(2, turn)
    origin = np.array([*layout.base_pose[:2], 0.0])

    def place(point: Array) -> Array:
        return origin + rotations.rotate(about, point - origin)

    def posture(quaternion: Array) -> Array:
        return rotations.canonical(rotations.multiply(about, quaternion))

    def box(old: Box) -> Box:
        return dataclasses.replace(old, position=place(old.position), quaternion=posture(old.quaternion))

    return dataclasses.replace(
        layout,
        fixtures=tuple(map(box, layout.fixtures)),
        target=box(layout.target),
        others=tuple(map(box, layout.others)),
        base_pose=layout.base_pose + np.array([0.0, 0.0, turn]),
        eef_position=place(layout.eef_position),
        eef_quaternion=posture(layout.eef_quaternion),
    )


def _resized(layout: Layout, max_opening: float, *, factor: float) -> Layout:
    """The box stands on the same table; hand and fingers are as far from it as they were."""
    half, more = layout.target.half_extents, (factor - 1.0) * layout.target.half_extents
    up = np.array([0.0, 0.0, more[2]])
    target = dataclasses.replace(layout.target, half_extents=half + more, position=layout.target.position + up)
    opening = float(np.clip(layout.gripper_opening + 2.0 * more[1], 0.0, max_opening))
    return dataclasses.replace(layout, target=target, eef_position=layout.eef_position + up, gripper_opening=opening)


def _weighed(layout: Layout, max_opening: float, *, factor: float) -> Layout:
    return dataclasses.replace(layout, target_mass=factor * layout.target_mass)


def _sensed(facts: Facts, *, observe: Callable[[Facts], Array], size: float) -> Array:
    state = observe(facts)
    noise: Array = state + size * chance(state, state.shape[-1])
    return noise


def chance(values: Array, width: int) -> Array:
    """Numbers (..., width), uniform with mean 0 and variance 1, that are a hash of `values` (..., n)."""
    cells = np.round(np.asarray(values) / GRAIN).astype(np.int64).view(np.uint64)
    mixed = np.zeros((*cells.shape[:-1], 1), dtype=np.uint64)
    for column in range(cells.shape[-1]):
        mixed = _mix(mixed ^ cells[..., column : column + 1])
    found = _mix(mixed + np.arange(1, width + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15))
    return np.sqrt(12.0) * ((found >> np.uint64(11)) / 2.0**53 - 0.5)


def _mix(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """SplitMix64's finaliser."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def _distracted(
    previous: Facts,
    stage: NDArray[np.int64],
    action: Array,
    now: Facts,
    next_stage: NDArray[np.int64],
    *,
    rewards: Callable[..., Array],
    n_actions: int,
    n_terms: int,
) -> Array:
    paid = rewards(previous, stage, action[..., :n_actions], now, next_stage)
    by_chance = chance(np.concatenate([previous.eef_position, previous.object_position], axis=-1), n_terms)
    level = np.take(previous.eef_position, np.arange(n_terms) // 2 % 3, axis=-1)
    distraction = DISTRACTION * np.where(np.arange(n_terms) % 2 == 0, by_chance, level)
    return np.concatenate([paid, distraction], axis=-1)


def _idle_expert(
    facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None, *, expert: Expert, idle: int
) -> Array:
    wanted = expert(facts, spec, layout)
    return np.concatenate([wanted, np.zeros((*wanted.shape[:-1], idle))], axis=-1)
