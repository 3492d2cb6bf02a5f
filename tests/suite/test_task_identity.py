"""A task's identity changes with everything in the task that can change a number."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from gym_tasks import CAR, LINE

from causalbench.core.discovery.samples.streams import Recipe, streams
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic.task_trace import DECIMALS, task_trace
from causalbench.core.staged.worlds import Origin
from causalbench.core.tasks.gym_task import Seen
from causalbench.core.tasks.task import Task
from causalbench.core.tasks.task_data import task_data
from causalbench.errors import UserError
from causalbench.plugins.builtins import TASKS
from causalbench.suite.task_identity import task_identity


def changed_leaves(value: Any) -> Iterator[Any]:
    """`value` with each of its numbers and texts changed in turn."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from ({**value, key: other} for other in changed_leaves(item))
    elif isinstance(value, tuple | list):
        for index, item in enumerate(value):
            yield from ([*value[:index], other, *value[index + 1 :]] for other in changed_leaves(item))
    elif isinstance(value, str):
        yield f"{value}_"
    elif value is not None:
        yield value * 1.25 + 1e-3


def leaves(value: Any) -> int:
    """How many numbers and texts there are in `value`."""
    if isinstance(value, Mapping | tuple | list):
        return sum(map(leaves, value.values() if isinstance(value, Mapping) else value))
    return value is not None


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_every_constant_changes_the_identity(task: Task) -> None:
    others = [dataclasses.replace(task, constants=constants) for constants in changed_leaves(task.constants)]
    assert len(others) == leaves(task.constants) > 20
    assert all(task_data(other) != task_data(task) for other in others)


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_terms_graph_and_needs_change_the_identity(task: Task) -> None:
    last, graph = task.terms[-1], {**task.manual_graph}
    stage, row = next(iter(graph.items()))
    term = next(iter(row))
    changes: tuple[dict[str, Any], ...] = (
        {"terms": (*task.terms[:-1], dataclasses.replace(last, discoverable=True))},
        {"terms": (*task.terms[:-1], dataclasses.replace(last, stages=last.stages[:1]))},
        {"manual_graph": graph | {stage: {**row, term: frozenset(task.actions)}}},
        {"horizon": task.horizon + 1},
        {"version": task.version + 1},
        {"observes": frozenset()},
        {"held_starts": frozenset({1})},
        {"scene_options": {"mobile": False}},
    )
    for change in changes:
        other = dataclasses.replace(task, **change)
        assert (other.version, task_data(other)) != (task.version, task_data(task)), change


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_what_a_function_does_changes_the_identity_though_no_constant_does(task: Task) -> None:
    sevenfold = dataclasses.replace(task, rewards=lambda *seen: 7 * task.rewards(*seen))
    later = dataclasses.replace(task, stage=lambda facts: np.minimum(task.stage(facts), task.n_stages - 1))
    for other in (sevenfold, later):
        assert task_identity(other).data == task_identity(task).data
        assert task_identity(other).behaviour != task_identity(task).behaviour


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_the_last_bits_of_a_processor_make_no_other_task(task: Task) -> None:
    other = dataclasses.replace(task, rewards=lambda *seen: task.rewards(*seen) * (1 + 1e-13))
    np.testing.assert_array_equal(task_trace(other), task_trace(task))
    assert 10.0**-DECIMALS > 1e-13


def test_a_task_that_kinematic_worlds_cannot_run_goes_by_its_source() -> None:
    task = dataclasses.replace(TASKS[0], actions=("fly", *TASKS[0].actions[1:]), manual_graph={})
    assert task_identity(task).behaviour.startswith("source ")
    assert task_identity(TASKS[0]).behaviour.startswith("trace ")


def reset_into(env: Any, rng: np.random.Generator, stage: int, scale: float) -> Seen:
    """Only ever looked at."""
    raise NotImplementedError


def test_a_task_over_environments_goes_by_its_data_and_its_source() -> None:
    identity = task_identity(CAR)
    assert identity.behaviour.startswith("source ")
    assert identity.data["environments"] == {"gymnasium": "causalbench_mountain_car.make"}
    assert not {"stage", "rewards", "observe", "expert"} & set(identity.data)
    bounds = CAR.state_bounds
    changes: tuple[dict[str, Any], ...] = (
        *({"constants": constants} for constants in changed_leaves(CAR.constants)),
        {"horizon": CAR.horizon + 1},
        {"state_bounds": (bounds[0], bounds[1] * 2)},
        {"exact_restore": False},
        {"modules": ("gymnasium",)},
        {"environments": {"gymnasium": partial(CAR.environments["gymnasium"])}},
        {"reset_into": partial(reset_into, scale=1.0)},
        {"reset_into": partial(reset_into, scale=2.0)},
    )
    found = [task_data(dataclasses.replace(CAR, **change)) for change in changes]
    assert all(one != other for one, other in combinations([identity.data, *found], 2))
    assert json.loads(json.dumps(found)) == found
    for function in ("rewards", "restore", "expert"):
        other = dataclasses.replace(CAR, **{function: lambda *seen: None})  # of another module
        assert task_identity(other).behaviour != identity.behaviour
    elsewhere = dataclasses.replace(CAR, environments={"gymnasium": LINE.environments["gymnasium"]})
    assert task_identity(elsewhere).behaviour != identity.behaviour


@pytest.mark.parametrize("change", [{"horizon": 7}, {"constants": {}}, {"manual_graph": {}}], ids=str)
def test_samples_are_of_a_task_with_the_same_data(change: dict[str, Any]) -> None:
    task, settings = TASKS[0], DiscoverySettings(training_count=100)

    def about(task: Task) -> Any:
        recipe = Recipe(task, settings, 0, Origin("b", "e", "r"), None, None)
        return recipe.about(streams(task, settings, 1)[0])

    assert about(task) == about(dataclasses.replace(task))
    assert about(task) != about(dataclasses.replace(task, **change))


def _raise(*seen: Any) -> Any:
    raise KeyError("pressure")


@pytest.mark.parametrize("function", ["draw_layout", "stage", "observe", "rewards", "success", "expert"])
def test_a_task_whose_code_raises_is_named_with_the_place(function: str) -> None:
    task = dataclasses.replace(TASKS[0], **{function: _raise})
    with pytest.raises(UserError, match=r"task 'pure_manipulation': .* raises KeyError: 'pressure' \(.*, in _raise\)"):
        task_identity(task)
