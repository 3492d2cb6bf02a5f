"""Starts of a task over scenes: drawn again until the scene takes one that the task means."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.core.staged.start_extras import start_extras, with_extras
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import BatchScene, select
from causalbench.core.world.facts import Facts
from causalbench.errors import LayoutDrawError, UnreachableLayoutError

MAX_DRAWS = 200
"""Starts that may be refused in a row before a reset gives up."""


def draw_starts(
    task: Task, batch: BatchScene, worlds: Sequence[int], rngs: Sequence[np.random.Generator], stage: int | None = None
) -> None:
    """Reset some worlds of `batch`, each to a start drawn from its own generator.

    A start is drawn again until it is reachable, free of contact and lies inside `stage` (any if None); it holds the
    object only in a stage of `task.held_starts`. Raises `LayoutDrawError` after `MAX_DRAWS` refused draws.
    """
    pending = list(zip(worlds, rngs, strict=True))
    refusal = "none"
    for _ in range(MAX_DRAWS):
        placed = []
        for world, rng in pending:
            try:
                _place(task, batch, world, rng, stage or 1)
                placed.append(world)
            except UnreachableLayoutError as error:
                refusal = str(error)
        good: set[int] = set()
        if placed:  # a world that refused its first start has no facts yet
            facts = with_extras(batch.facts_of(placed), start_extras([batch.layout_of(world) for world in placed]))
            usable = _usable(task, facts, stage)
            good = {world for world, fine in zip(placed, usable, strict=True) if fine}
        pending = [(world, rng) for world, rng in pending if world not in good]
        if not pending:
            return
    unfit = pending[0][0]
    if unfit in placed:
        refusal = _fault(task, select(facts, placed.index(unfit)), stage)
    raise _no_start(task, batch, stage, refusal)


def _place(task: Task, batch: BatchScene, world: int, rng: np.random.Generator, stage: int) -> None:
    """Draw a layout and put the world into it. Raises `UnreachableLayoutError`."""
    batch.reset(world, task.draw_layout(rng, batch.spec.workspace, batch.spec.max_opening, stage))


def _usable(task: Task, facts: Facts, stage: int | None) -> NDArray[np.bool_]:
    """(n,) which starts are free of contact, hold nothing that they may not, and lie inside `stage`."""
    inside = task.stage(facts)
    held = facts.holding & ~np.isin(inside, list(task.held_starts))
    usable: NDArray[np.bool_] = ~(facts.collision_base | facts.collision_arm | facts.collision_self | held)
    return usable if stage is None else usable & (inside == stage)


def _fault(task: Task, facts: Facts, stage: int | None) -> str:
    """Why a start that the scene took does not serve, `facts` being those of one world."""
    inside = int(task.stage(facts))
    for flag in ("collision_base", "collision_arm", "collision_self"):
        if getattr(facts, flag):
            return f"it is in contact ({flag})"
    if facts.holding and inside not in task.held_starts:
        return f"it holds the object in stage {inside}, and the task's held_starts are {sorted(task.held_starts)}"
    return f"it lies in stage {inside}, not in stage {stage}"


def _no_start(task: Task, batch: BatchScene, stage: int | None, refusal: str) -> LayoutDrawError:
    where = "" if stage is None else f" in stage {stage}"
    return LayoutDrawError(
        f"task {task.name!r} found no start{where} on backend {batch.spec.backend!r} in {MAX_DRAWS} draws: "
        f"each was refused by the scene, in contact, in another stage or held the object where the task does not say "
        f"so (`held_starts`). The last one: {refusal}. The declared workspace: {batch.spec.workspace}"
    )
