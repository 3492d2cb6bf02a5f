"""Tasks that differ from a registered one in what their name says: `NAME+CHANGE`, such as `pure_manipulation+merged`.

Several changes stand one after the other: `pure_manipulation+base_yaw=0.5+sensor_noise=0.01`. The task as it is keeps
its name and its identity.
"""

from __future__ import annotations

import dataclasses
import math
from functools import reduce

from causalbench.core.tasks.changes.decompositions import DECOMPOSITIONS, decomposed
from causalbench.core.tasks.changes.scenes import SCENES
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.tasks.task import Task
from causalbench.errors import UnknownNameError, UserError


def changed(task: StageTask, name: str) -> Task:
    """`task` with the changes that `name`, such as "pure_manipulation+merged", says after the task's name.

    It has no Gymnasium id of its own. Raises `UserError` for a change that does not exist or does not fit the task.
    """
    if not isinstance(task, Task):
        raise UserError(f"task {name!r}: only tasks over scenes can be changed, and {task.name!r} brings its own")
    new = reduce(_change, name.split("+")[1:], task)
    return dataclasses.replace(new, name=name, env_id="")


def _change(task: Task, text: str) -> Task:
    kind, has_number, number = text.partition("=")
    if kind in DECOMPOSITIONS and not has_number:
        return decomposed(task, kind)
    if kind not in SCENES:
        raise UnknownNameError("change of a task", text, (*DECOMPOSITIONS, *(f"{name}=NUMBER" for name in SCENES)))
    return SCENES[kind](task, _number(kind, number))


def _number(kind: str, text: str) -> float:
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise UserError(f"change {kind!r} of a task: expected {kind}=NUMBER, got {text!r}")
    return found
