"""Bad decompositions of pure manipulation: what happens where its stages, tolerances or terms are chosen badly.

Each is a `Decomposition`, and `decomposed` makes a task of it. `changes.named` has the names.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.tasks import pure_manipulation as pure
from causalbench.core.tasks import pure_manipulation_data as data
from causalbench.core.tasks.pure_manipulation_data import C
from causalbench.core.tasks.reward_scales import SCALES
from causalbench.core.tasks.stage_task import Term
from causalbench.core.tasks.stages import active_terms, staged_potential
from causalbench.core.tasks.task import Task
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.core.world.scene import SceneSpec
from causalbench.errors import UserError

Array = NDArray[np.float64]
Stages = NDArray[np.int64]

MOVE, TURN, LOWER, GRASP = 1, 2, 3, 4
FAR_TURN = 1.2  # rad of tilt beyond which `split` begins a stage of its own; no start is tilted so far
SLIVER = 0.004  # m above the grasp's tolerance that `sliver` makes a stage of its own
LEVEL = 1.0  # per metre of the hand from the box, what `level` charges
ALL = (1, 2, 3, 4)
GRIPPER = pure.TASK.term_names.index("r_gripper")


class Decomposition(NamedTuple):
    """How pure manipulation is cut otherwise.

    - `like`: of each stage, the one of pure manipulation that it is, a part of it, or begins with;
    - `terms`: name of a term -> the stages that pay it, where that is not what `like` says;
    - `tolerance`: what the tolerances of the stages are multiplied by;
    - `extra`: terms that pure manipulation does not have;
    - `shaped`: whether the task still has a potential, without which a learner climbs the sum of the terms.
    """

    description: str
    like: tuple[int, ...] = ALL
    terms: Mapping[str, tuple[int, ...]] = {}
    tolerance: float = 1.0
    extra: tuple[Term, ...] = ()
    shaped: bool = True


DECOMPOSITIONS = {
    "merged": Decomposition("moving and turning are one stage", (MOVE, LOWER, GRASP), {"r_ori": (1,)}),
    "split": Decomposition("turning is split where no episode comes by", (MOVE, TURN, TURN, LOWER, GRASP)),
    "sliver": Decomposition("the last millimetres of lowering are a stage", (MOVE, TURN, LOWER, LOWER, GRASP)),
    "halved": Decomposition("all tolerances are halved", tolerance=0.5),
    "doubled": Decomposition("all tolerances are doubled", tolerance=2.0),
    "swapped": Decomposition("turning is numbered after lowering", (MOVE, LOWER, TURN, GRASP)),
    "misplaced": Decomposition("turning is paid for while the hand moves", terms={"r_ori": (1,)}),
    "level": Decomposition(
        "a term pays for where a step began", extra=(Term("r_level", (1,), True, "distance from the box before"),)
    ),
    "idle": Decomposition(
        "the penalty for closing early is a term of its own, of all stages",
        terms={"r_gripper": (4,)},
        extra=(Term("r_early", ALL, True, "closing before stage 4"),),
    ),
    "unshaped": Decomposition("learners climb the sum of the terms", shaped=False),
}  # fmt: skip


def decomposed(task: Task, name: str) -> Task:
    """Pure manipulation cut as `DECOMPOSITIONS[name]` says. Raises `UserError` for another task."""
    if task is not pure.TASK:
        raise UserError(
            f"task {task.name!r}: the change {name!r} is of {pure.TASK.name}'s stages alone, and comes first"
        )
    plan = DECOMPOSITIONS[name]
    terms = terms_of(name)
    manual: dict[str, frozenset[str]] = {term: row for by in data.MANUAL_GRAPH.values() for term, row in by.items()}
    manual |= {"r_level": frozenset(), "r_early": manual["r_gripper"]}
    stages = range(1, len(plan.like) + 1)
    return dataclasses.replace(
        task,
        n_stages=len(plan.like),
        terms=terms,
        manual_graph={i: {t.name: manual[t.name] for t in terms if t.discoverable and i in t.stages} for i in stages},
        draw_layout=partial(draw_layout, name=name),
        stage=partial(stage, name=name),
        success=partial(success, name=name),
        rewards=partial(rewards, name=name),
        expert=partial(expert, name=name),
        potential=partial(potential, name=name) if plan.shaped else None,
        potential_terms=task.potential_terms if plan.shaped else (),
    )


@cache
def terms_of(name: str) -> tuple[Term, ...]:
    """The terms in vector order, each with the stages that pay it in the decomposition `name`."""
    plan = DECOMPOSITIONS[name]
    here = {term.name: tuple(i for i, old in enumerate(plan.like, 1) if old in term.stages) for term in data.TERMS}
    here |= plan.terms
    return (*(dataclasses.replace(term, stages=here[term.name]) for term in data.TERMS), *plan.extra)


@cache
def _active(name: str) -> NDArray[np.bool_]:
    return active_terms(terms_of(name), len(DECOMPOSITIONS[name].like))


def draw_layout(rng: np.random.Generator, workspace: Workspace, max_opening: float, stage: int, *, name: str) -> Layout:
    """A start inside `stage`: one of the stage that it is like, moved into a part that no start lies in by itself."""
    layout = pure.draw_layout(rng, workspace, max_opening, DECOMPOSITIONS[name].like[stage - 1])
    if (name, stage) == ("split", 2):
        turned = rotations.multiply(layout.eef_quaternion, rotations.from_axis_angle(1, -FAR_TURN))
        return dataclasses.replace(layout, eef_quaternion=rotations.canonical(turned))
    if (name, stage) == ("sliver", 4):
        hand = layout.eef_position.copy()
        hand[2] = layout.target.position[2] + C.grasp_height + C.tolerance_grasp + SLIVER / 2
        return dataclasses.replace(layout, eef_position=hand)
    return layout


def stage(facts: Facts, *, name: str) -> Stages:
    """U(s), int (...)."""
    plan, was = DECOMPOSITIONS[name], _stage_within(facts, DECOMPOSITIONS[name].tolerance)
    if name == "split":
        return np.where((was == TURN) & (pure.tilt(facts) <= FAR_TURN), 3, np.where(was > TURN, was + 1, was))
    if name == "sliver":
        height = facts.eef_position[..., 2] - facts.object_position[..., 2]
        last = height < C.grasp_height + C.tolerance_grasp + SLIVER
        return np.where((was == LOWER) & last, 4, np.where(was == GRASP, 5, was))
    # Of a stage that is a part of no other here, the one before it: moving goes on until lowering begins.
    table = [max(i for i, like in enumerate(plan.like, 1) if like == old or i == 1) for old in ALL]
    found: Stages = np.array([0, *table])[was]
    return found


def _stage_within(facts: Facts, scale: float) -> Stages:
    """The stage of pure manipulation, int (...), were its tolerances multiplied by `scale`."""
    if scale == 1.0:
        return pure.stage(facts)
    x, y, z = np.moveaxis(facts.eef_position - facts.object_position, -1, 0)
    beside = (abs(x) < scale * C.tolerance_xy) & (abs(y) < scale * C.tolerance_xy)
    hover, grasp = scale * C.tolerance_hover, scale * C.tolerance_grasp
    down = (pure.tilt(facts) < scale * C.tolerance_ori) & (C.grasp_height - grasp < z) & (z < C.hover + hover)
    low = np.where(abs(z - C.grasp_height) < grasp, GRASP, LOWER)
    return np.where(beside & down, low, np.where(beside & (abs(z - C.hover) < hover), TURN, MOVE))


def success(stage: Stages, now: Facts, *, name: str) -> NDArray[np.bool_]:
    """Bool (...): the box is held after a step from the last stage."""
    return (stage == len(DECOMPOSITIONS[name].like)) & now.holding


def rewards(
    previous: Facts, stage: Stages, action: Array, now: Facts, next_stage: Stages, *, name: str
) -> Array:  # fmt: skip
    """Reward vector (..., n_terms) of the step; every term as pure manipulation computes it, in the stages of here."""
    plan = DECOMPOSITIONS[name]
    old = np.array([0, *plan.like])[stage]
    paid = pure.scaled_rewards(previous, old, action, now, old, data.SCALE.max(0))
    paid[..., -1] = SCALES.stage_bonus * ((next_stage > stage) | success(stage, now, name=name))
    away = np.linalg.norm(previous.eef_position - previous.object_position, axis=-1)
    extra = {"r_level": -LEVEL * away, "r_early": np.where(old < GRASP, paid[..., GRIPPER], 0.0)}
    columns = [paid, *(np.asarray(extra[term.name])[..., None] for term in plan.extra)]
    return np.where(_active(name)[stage], np.concatenate(columns, axis=-1), 0.0)


def expert(
    facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None, *, name: str
) -> Array:  # fmt: skip
    """Pure manipulation's expert, within the tolerances of here."""
    del layout
    return pure.act(facts, spec, _stage_within(facts, DECOMPOSITIONS[name].tolerance))


def potential(state: Array, stage: Stages, *, name: str) -> Array:
    """See `StageTask.potential`: what the terms of every stage would still pay."""
    plan = DECOMPOSITIONS[name]
    left, most = pure.ways(state)
    ways = [_way(name, i, left, most) for i in range(1, len(plan.like) + 1)]
    return staged_potential(stage, [way for way, _ in ways], [top for _, top in ways], SCALES.stage_bonus)


def _way(name: str, stage: int, left: Sequence[Array], most: Sequence[float]) -> tuple[Array, float]:
    """What the progress terms of one stage would still pay, and what they pay at most."""
    paid = {term.name for term in terms_of(name) if stage in term.stages}
    parts = [i for i, term in enumerate(("r_eefx", "r_ori", "r_eefz2")) if term in paid]
    return np.sum([np.zeros_like(left[0]), *(left[i] for i in parts)], axis=0), sum(most[i] for i in parts)
