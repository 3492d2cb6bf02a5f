"""The tasks of two examples, each wrong in one way: `BROKEN` maps a number of the contract to what breaks it."""

from __future__ import annotations

import atexit
import dataclasses
import itertools
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np

EXAMPLES = Path(__file__).parents[2] / "examples"
MODULES = Path(tempfile.mkdtemp())
"""The modules alone, for the path of new processes: beside the examples may lie what makes them installed plugins."""
atexit.register(shutil.rmtree, MODULES)
for path in (EXAMPLES / "a_task/causalbench_hover.py", EXAMPLES / "a_gym_task/causalbench_mountain_car.py"):
    shutil.copy(path, MODULES)
sys.path.insert(0, str(MODULES))

import causalbench_hover as hover  # noqa: E402
import causalbench_mountain_car as car  # noqa: E402
from causalbench.core.tasks.stage_task import StageTask  # noqa: E402

HOVER, CAR = hover.TASK, car.TASK


def wrong(**changes: object) -> StageTask:
    return dataclasses.replace(HOVER, **changes)


def of_another_process(previous, before, action, now, after):
    return hover.rewards(previous, before, action, now, after) * (1 + os.getpid() % 97)


def stage_0(facts):
    """No stage just beside the box."""
    x = np.abs(hover.offset(facts)[..., 0])
    return np.where((x > 0.03) & (x < 0.06), 0, hover.stage(facts))


last = SimpleNamespace(stage=1, facts=None, paid=0.0, buffer=np.zeros(4), draws=itertools.count())


def hysteresis(facts):
    """Above the box is left later than it is entered."""
    if facts.eef_position.ndim > 1:  # as starts are judged, which is when what was before is forgotten
        last.stage = 1
        return hover.stage(facts)
    wide = (np.abs(hover.offset(facts)[..., :2]) < 2 * hover.C.tolerance_xy).all(-1)
    last.stage = np.where(wide & (last.stage == 2), 2, hover.stage(facts))
    return last.stage


def second_stage_alone(rng, workspace, max_opening, stage):
    return hover.draw_layout(rng, workspace, max_opening, 2)


def one_start(rng, workspace, max_opening, stage):
    return hover.draw_layout(np.random.default_rng(2), workspace, max_opening, stage)


def counted(rng, workspace, max_opening, stage):
    layout = hover.draw_layout(rng, workspace, max_opening, stage)
    higher = np.array([0.0, 0.0, 1e-12 * next(last.draws)])
    return dataclasses.replace(layout, eef_position=layout.eef_position + higher)


def of_all_worlds(previous, before, action, now, after):
    paid = hover.rewards(previous, before, action, now, after)
    return paid - paid.mean(0) if paid.ndim == 2 else paid


def too_fast(env, content):
    seen = car.restore(env, content)
    env.unwrapped.state = env.unwrapped.state * np.array([1.0, 1.05], env.unwrapped.state.dtype)
    return seen._replace(observation=env.unwrapped.state.astype(np.float32))


def in_place(facts, spec, layout=None):
    facts.eef_quaternion[...] *= -1.0
    return hover.expert(facts, spec, layout)


def everywhere(previous, before, action, now, after):
    """Terms of other stages are paid, too."""
    approach = hover.C.per_metre * (np.abs(hover.offset(previous)) - np.abs(hover.offset(now)))
    return np.concatenate([approach, hover.rewards(previous, before, action, now, after)[..., 3:]], axis=-1)


def one_buffer(previous, before, action, now, after):
    paid = hover.rewards(previous, before, action, now, after)
    if paid.ndim > 1:
        return paid
    last.buffer[:] = paid
    return last.buffer


def of_the_past(previous, before, action, now, after):
    """The bonus is paid again on the step after."""
    paid = hover.rewards(previous, before, action, now, after)
    bonus = paid * np.array([0.0, 0.0, 0.0, 1.0])
    if last.facts is previous:
        paid = paid + last.paid
    last.facts, last.paid = now, bonus
    return paid


def no_height(previous, before, action, now, after):
    return hover.rewards(previous, before, action, now, after) * np.array([1.0, 1.0, 0.0, 1.0])


def only_forward(previous, before, action, now, after):
    return np.maximum(hover.rewards(previous, before, action, now, after), 0.0)


def hole(facts):
    state = hover.offset(facts)
    return np.where([True, False, False] & (np.abs(state) > 0.03), np.nan, state)


def feature_with_a_hole(state):
    return np.where(state[..., :1] > 0.0, np.nan, state[..., :1])


def debts(state, now):
    return hover.potential(state, now) - 100.0


def anywhere_above(before, now):
    return hover.stage(now) == 2


def unbounded(facts, spec, layout=None):
    return 3.0 * hover.expert(facts, spec, layout)


def idle(facts, spec, layout=None):
    return np.zeros_like(hover.offset(facts))


TERMS = tuple(dataclasses.replace(t, discoverable=t.name in ("r_x", "r_y")) for t in hover.TERMS)

BROKEN: dict[str, StageTask] = {
    "T1": wrong(constants={"place": object()}),
    "T2": wrong(rewards=of_another_process),
    "T3": dataclasses.replace(CAR, modules=("causalbench_mountain_car",)),
    "T4": wrong(env_id="hover/Hoover-v0"),
    "T5": wrong(terms=TERMS),
    "T6": wrong(stage=stage_0),
    "T7": wrong(stage=hysteresis),
    "T8": wrong(draw_layout=second_stage_alone),
    "T9": wrong(draw_layout=one_start),
    "T10": wrong(draw_layout=counted),
    "T11": wrong(rewards=of_all_worlds),
    "T12": dataclasses.replace(CAR, restore=too_fast),
    "T13": wrong(expert=in_place),
    "T14": wrong(rewards=everywhere),
    "T15": wrong(rewards=one_buffer),
    "T16": wrong(rewards=of_the_past),
    "T17": wrong(rewards=no_height),
    "T18": wrong(rewards=only_forward),
    "T19": wrong(observe=hole),
    "T20": wrong(state_bounds=lambda workspace: (np.full(3, -0.05), np.full(3, 0.05))),
    "T21": wrong(features=feature_with_a_hole, feature_names=("far",)),
    "T22": wrong(potential=debts),
    "T23": wrong(success=anywhere_above),
    "T24": wrong(expert=unbounded),
    "T25": wrong(expert=idle),
    "T26": wrong(after_success=lambda scene: False),
}
