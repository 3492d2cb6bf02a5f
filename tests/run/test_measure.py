"""`causalbench plan --measure`: what cells take, from trying one of each kind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from causalbench.plugins.manager import installed
from causalbench.run import measure
from causalbench.run.measure import Needs, kind_of
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


def test_one_cell_of_each_kind_is_tried_and_stands_for_all_seeds(
    tiny_suite: Path, cli: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One discovery, and cmSAC and mSAC of two seeds each; mSAC cannot be tried."""
    tried = []

    def pretend(function: object, cell: object) -> Needs:
        tried.append(cell.identity.get("method", {}).get("name", "discovery"))  # type: ignore[attr-defined]
        if tried[-1] == "mSAC":
            raise RuntimeError("the arm fell off")
        return Needs(30.0 * len(tried), 2e6, 3e8)

    monkeypatch.setattr(measure, "call_in_spawned_process", pretend)
    call = ("plan", tiny_suite, "--tier", "smoke", "--seeds", "2", "--measure", "--jobs", "2")
    done = cli(*call, "--json")
    assert tried == ["discovery", "cmSAC", "mSAC"]
    cells = json.loads(done.stdout)["cells"]
    assert [(row["seconds"], row["disk"], row["env_steps"]) for row in cells] == [
        (30.0, 2e6, None), (60.0, 2e6, 120), (60.0, 2e6, 120), (None, None, 120), (None, None, 120),
    ]  # fmt: skip
    assert "mSAC-s0-" in done.stderr
    assert "cannot be tried: the arm fell off" in done.stderr
    tried.clear()
    table = cli(*call, "--only", "method=cmSAC").stdout
    assert "3 of 3 cells to run, 240 steps of training beside those of discovery" in table
    assert "About 1 min left, 2 cells at a time; 6 MB on the disk, 600 MB of memory." in table  # 30 + 60 + 60 s


def test_the_speed_is_that_of_the_second_half() -> None:
    clock = measure._Clock()
    clock.times = [(0.0, 0.0), (2.0, 0.01), (3.0, 0.02), (4.0, 0.03)]
    assert clock.seconds() == pytest.approx(100.0)
    clock.times = [(0.0, 0.0), (4.0, 0.5)]
    assert clock.seconds() == pytest.approx(8.0)


def test_a_kind_is_all_but_the_seed_and_its_graph(tiny_suite: Path) -> None:
    file = load_suite(tiny_suite, installed())
    kinds = [kind_of(cell) for cell in make_plan(file, "smoke", installed(), seeds=3).cells]
    assert len(set(kinds)) == 3


@pytest.mark.long
def test_a_discovery_and_a_learner_are_really_tried(tiny_suite: Path) -> None:
    """Nothing of the machine's speed is asserted."""
    cells = make_plan(load_suite(tiny_suite, installed()), "smoke", installed()).cells
    said: list[str] = []
    found = measure.measure(cells, said.append)
    assert found.keys() == {cell.id for cell in cells}, said
    assert all(needs.seconds > 0 and 5e7 < needs.memory < 5e9 and needs.disk >= 3e5 for needs in found.values())
