"""Stacking: close the hand around a box (stage 1), lift it beside another one (stage 2). Its starts hold the box there.

It needs what no built-in task does: two objects, starts after a grasp, and numbers that differ from start to start.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from causalbench.core.tasks import pure_manipulation
from causalbench.core.tasks.stage_task import Term
from causalbench.core.tasks.stages import active_terms
from causalbench.core.tasks.task import Task
from causalbench.core.world.capabilities import Capability

LIFT = 0.08  # m above the table, where stage 2 ends
SQUEEZED = 0.01  # m that the opening of a held start is below the box's width
TERMS = (
    Term("r_grasp", (1,), True, "for the grasp"),
    Term("r_lift", (2,), True, "the box's rise above the table"),
)
ACTIVE = active_terms(TERMS, 2)


def draw_layout(rng, workspace, max_opening, stage):
    """The hand around the box, a second one of a drawn height beside it, on a table of a drawn height."""
    layout = pure_manipulation.draw_layout(rng, workspace, max_opening, 4)
    box, drop = layout.target, 0.05 * rng.random()
    if stage == 2:
        layout = dataclasses.replace(layout, gripper_opening=2 * box.half_extents[1] - SQUEEZED)
    table = layout.fixtures[0]
    layout = dataclasses.replace(
        layout,
        fixtures=(dataclasses.replace(table, position=table.position - [0, 0, drop]), *layout.fixtures[1:]),
        others=(dataclasses.replace(box, name="base", position=box.position + [0.1, 0.2, 0.0]),),
        other_masses=(0.2,),
    )
    top = layout.fixtures[0].position[2] + layout.fixtures[0].half_extents[2]
    return dataclasses.replace(layout, extras={"table": float(top), "goal": layout.others[0].position + [0, 0, 0.1]})


def height(facts):
    """Metres (...) from the table to the middle of the box."""
    return facts.object_position[..., 2] - facts.extras["table"]


def observe(facts):
    """The height of the box and the way from it to the goal (..., 4)."""
    return np.concatenate([height(facts)[..., None], facts.extras["goal"] - facts.object_position], axis=-1)


def success(before, now):
    return (before == 2) & now.holding & (height(now) > LIFT)


def rewards(previous, before, action, now, after):
    rise = 10 * (height(now) - height(previous))
    return np.stack([1.0 * now.holding, rise], axis=-1) * ACTIVE[before]


def expert(facts, spec, layout=None):
    stage = facts.holding + 1
    return np.stack([stage == 2, stage == 1], axis=-1).astype(float)


STACKING = Task(
    name="stacking",
    version=0,
    env_id="causalbench/Stacking-v0",
    n_stages=2,
    actions=("armz", "grip"),
    terms=TERMS,
    state_names=("height", "goal_x", "goal_y", "goal_z"),
    horizon=40,
    constants={"lift": LIFT, "squeezed": SQUEEZED},
    manual_graph={1: {"r_grasp": frozenset({"grip"})}, 2: {"r_lift": frozenset({"armz"})}},
    draw_layout=draw_layout,
    state_bounds=lambda workspace: (-np.ones(4), np.ones(4)),
    observe=observe,
    stage=lambda facts: facts.holding + np.int64(1),
    success=success,
    rewards=rewards,
    expert=expert,
    requires=frozenset({Capability.SEVERAL_OBJECTS}),
    held_starts=frozenset({2}),
)
