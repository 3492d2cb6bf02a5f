"""A task is closed: its numbers are all among its constants, and what it names exists."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json

import pytest

from causalbench.core.tasks import (
    lift_and_hold,
    mobile_manipulation,
    pure_manipulation,
    pure_manipulation_dense,
    reward_scales,
    rooms,
    stack,
)
from causalbench.core.tasks.stage_task import Term
from causalbench.errors import UserError
from causalbench.plugins.builtins import TASKS

MODULES = {
    "pure_manipulation": (pure_manipulation, lift_and_hold, reward_scales),
    "pure_manipulation_dense": (pure_manipulation_dense, pure_manipulation, lift_and_hold, reward_scales),
    "stack": (stack, pure_manipulation, reward_scales),
    "mobile_manipulation": (mobile_manipulation, rooms, reward_scales),
}
PLAIN = {0.0, 1.0, 2.0, 1e-9}
"""Halves and a guard against division by 0, which are no choice."""
ELSEWHERE = {"N_STAGES", "ALL_STAGES", "SCALE", "HORIZON", "WAYS_KEPT"}
"""Fields of the task, what follows from constants, and what changes no number."""


def flat(value) -> set[float]:
    """The numbers in JSON data, without their signs."""
    if isinstance(value, dict):
        return flat(list(value.values()))
    if isinstance(value, list):
        return set().union(*map(flat, value))
    return {abs(value)} if isinstance(value, int | float) else set()


def chosen_numbers(module) -> set[float]:
    """The floats in a module's text, without their signs, but those of what `ELSEWHERE` names."""
    found = set()
    for node in ast.parse(inspect.getsource(module)).body:
        names = {target.id for target in getattr(node, "targets", ()) if isinstance(target, ast.Name)}
        if not names & ELSEWHERE:
            inner = (part for part in ast.walk(node) if isinstance(part, ast.Constant))
            found |= {part.value for part in inner if isinstance(part.value, float)}
    return found - PLAIN


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_every_number_in_the_text_is_among_the_constants(task):
    constants = flat(json.loads(json.dumps(task.constants)))
    for module in MODULES[task.name]:
        assert chosen_numbers(module) - constants == set(), module.__name__


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"terms": (Term("r", (7,), True, ""),), "manual_graph": {}}, "term 'r': stages \\(7,\\)"),
        ({"terms": (), "manual_graph": {}}, "terms: expected at least one name"),
        ({"actions": ("armx", "armx")}, "actions: .* each once"),
        ({"manual_graph": {1: {"r_nothing": frozenset()}}}, "stage 1 has no r_nothing"),
        ({"manual_graph": {1: {"r_success": frozenset({"armq"})}}}, "stage 1 has no armq"),
        ({"observes": frozenset({"smell"})}, "observes: \\['smell'\\]"),
        ({"observes": frozenset({"lidar"}), "requires": frozenset()}, "`requires` must name"),
        ({"features": None}, "must be given together"),
        ({"feature_names": ("near", "near")}, "state_names, feature_names: expected each name once"),
    ],
)
def test_a_task_that_names_what_does_not_exist_is_refused(task, change, message):
    with pytest.raises(UserError, match=message):
        dataclasses.replace(task, **change)
