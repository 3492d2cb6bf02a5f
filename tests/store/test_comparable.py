"""Which cells may stand in one table, and what two runs must share to be merged."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
from stored import LEARNER, finished

from causalbench.errors import RunFolderError
from causalbench.store.comparable import check_comparable, merged
from causalbench.store.run_folder import RunFolder


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("env_steps", 200, "the budget on b is {'env_steps': 200} and {'env_steps': 100}"),
        ("task", {"name": "t", "version": 1}, "the task is {'version': 1} and {'version': 0}"),
        ("task", {"name": "t", "version": 0, "more": 1}, "the task is {'more': 1} and {'more': None}"),
        ("learner", {"gamma": 0.5}, "the learner of m on b is {'gamma': 0.5} and {'gamma': 0.9}"),
        ("backend", {"name": "b", "version": "2"}, "backend b is {'version': '2'} and {'version': '1'}"),
        ("code", "2", "causalbench's version is '2' and '1'"),
    ],
)
def test_cells_that_cannot_be_compared_are_refused_by_name(key: str, value: object, message: str) -> None:
    other = copy.deepcopy(LEARNER) | {key: value}
    with pytest.raises(RunFolderError) as caught:
        check_comparable([("one", LEARNER), ("two", other)])
    assert str(caught.value).startswith(f"two and one cannot be compared: {message}; ")


def test_cells_that_differ_in_seed_method_or_backend_are_compared() -> None:
    others = [
        {"seed": 5},
        {"method": {"name": "n"}, "learner": {"gamma": 0.1}},
        {"backend": {"name": "c", "version": "7"}, "evaluation": {"every": 3}, "env_steps": 300},
    ]
    check_comparable([("one", LEARNER), *(("other", LEARNER | other) for other in others)])


def test_a_cell_that_stands_in_two_runs_counts_once_and_the_finished_one(tmp_path: Path) -> None:
    one, other = RunFolder(tmp_path / "one"), RunFolder(tmp_path / "other")
    cell = finished(one)
    other.start(cell)
    finished(other, seed=1)
    for order in ([one, other], [other, one]):
        found = merged(cell for run in order for cell in run.cells())
        assert [(c.seed, c.status.state) for c in found] == [(0, "done"), (1, "done")]


def test_one_cell_with_two_results_is_refused_by_the_names_of_the_files(tmp_path: Path) -> None:
    one, other = RunFolder(tmp_path / "one"), RunFolder(tmp_path / "other")
    cell = finished(one, success=0.5)
    assert merged([*one.cells(), *one.cells()])
    finished(other, success=0.75)
    with pytest.raises(RunFolderError) as caught:
        merged([*one.cells(), *other.cells()])
    assert str(caught.value).startswith(
        f"{one.folder(cell)} and {other.folder(cell)} are the same cell with different results "
        "(policy/policy.json, progress.csv); "
    )
