"""What is not tried again and again, and when a cell has had time enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from causalbench.plugins.manager import installed
from causalbench.run.executors.giving_up import ENOUGH
from causalbench.run.executors.limits import FLOOR, SILENCE, Limits
from causalbench.run.executors.processes import _Job
from causalbench.run.executors.schedule import schedule
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, DiscoveryCell, LearnerCell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


class Fake:
    """An executor whose cells end at once, as `how` says of a cell."""

    jobs = 1

    def __init__(self, run: RunFolder, how: dict[str, str], evaluated: bool = False) -> None:
        self.run, self.how, self.evaluated = run, how, evaluated
        self.started: list[Cell] = []
        self._over: list[Cell] = []

    def free(self) -> int:
        return self.jobs - len(self._over)

    def start(self, cell: Cell) -> None:
        folder = self.run.start(cell)
        if self.evaluated:
            (folder / "progress.csv").touch()
        method = "discovery" if isinstance(cell, DiscoveryCell) else cell.method.name
        reason = self.how.get(method, "").format(seed=cell.seed)
        self.run.finish(cell, Status("failed", reason) if reason else Status("done"))
        self.started.append(cell)
        self._over.append(cell)

    def ended(self) -> Sequence[Cell]:
        over, self._over = self._over, []
        return over

    def stop(self) -> None:
        """Nothing runs."""


@pytest.fixture
def cells(tiny_suite: Path) -> tuple[Cell, ...]:
    """Five discoveries, and the cells of cmSAC and mSAC for five seeds, on one backend."""
    text = tiny_suite.read_text().replace("seeds: 1", "seeds: 5, graphs: per_seed")
    tiny_suite.with_name("five.yaml").write_text(text)
    return make_plan(load_suite(tiny_suite.with_name("five.yaml"), installed()), "smoke", installed()).cells


def outcome(cells: Sequence[Cell], executor: Fake) -> dict[str, list[str]]:
    """State -> the cells that ended so, as method and seed."""
    found: dict[str, list[str]] = {}
    for cell, status in schedule(cells, executor.run, executor):
        name = "discovery" if isinstance(cell, DiscoveryCell) else cell.method.name
        found.setdefault(status.state, []).append(f"{name} {cell.seed}")
    return found


def test_a_backend_that_fails_in_the_same_way_is_given_up(cells: Sequence[Cell], tmp_path: Path) -> None:
    executor = Fake(RunFolder(tmp_path), {"discovery": "no display :{seed}", "mSAC": "no display :1{seed}"})
    found = outcome(cells, executor)
    assert len(executor.started) == len(found["failed"]) >= ENOUGH
    assert len(found["failed"]) + len(found["skipped"]) == len(cells)
    assert len({cell.identity["kind"] for cell in executor.started}) == 2  # so it is not laid to a method
    assert len(executor.started) <= ENOUGH + 1
    states = [executor.run.status(cell) for cell in cells]
    told = [
        status.reason for status in states if "failed alike before their first evaluation (no display" in status.reason
    ]
    assert told


def test_a_method_that_fails_alone_is_given_up_alone(cells: Sequence[Cell], tmp_path: Path) -> None:
    found = outcome(
        [cell for cell in cells if isinstance(cell, LearnerCell) and not cell.discovery],
        Fake(RunFolder(tmp_path), {"mSAC": "out of memory"}),
    )
    assert (found["failed"], found["skipped"]) == (["mSAC 0", "mSAC 1", "mSAC 2"], ["mSAC 3", "mSAC 4"])
    other = Fake(RunFolder(tmp_path / "other"), {"mSAC": "out of memory"})
    assert len(outcome(cells, other)["failed"]) == ENOUGH
    assert sum(isinstance(cell, DiscoveryCell) for cell in other.started) == 5


def test_cells_that_were_evaluated_are_no_reason_to_give_up(cells: Sequence[Cell], tmp_path: Path) -> None:
    plain = [cell for cell in cells if isinstance(cell, LearnerCell) and not cell.discovery]
    found = outcome(plain, Fake(RunFolder(tmp_path), {"mSAC": "no"}, evaluated=True))
    assert len(found["failed"]) == 5


def test_limits_are_ten_times_what_such_a_cell_took_and_an_hour_at_least(cells: Sequence[Cell]) -> None:
    plain = [cell for cell in cells if isinstance(cell, LearnerCell) and not cell.discovery]
    causal = next(cell for cell in cells if isinstance(cell, LearnerCell) and cell.discovery)
    limits = Limits(None)
    assert limits.of(plain[0]).seconds == float("inf")
    limits.took(plain[0], 20.0)
    assert limits.of(plain[1]).seconds == FLOOR
    limits.took(plain[1], 1_200.0)
    limits.took(plain[2], 900.0)
    assert limits.of(plain[3]).seconds == 12_000.0
    assert "200 minutes, where such a cell took 20.0" in limits.of(plain[3]).sentence
    assert limits.of(causal).seconds == float("inf")
    assert limits.of(causal).silence == SILENCE
    asked = Limits(60.0).of(causal)
    assert (asked.seconds, asked.silence) == (60.0, float("inf"))


class Hanging:
    """A process that runs until it is killed."""

    alive = True

    def resident_bytes(self) -> int:
        return 3_000_000_000

    def is_alive(self) -> bool:
        return self.alive

    def kill(self) -> None:
        self.alive = False


@pytest.mark.parametrize(
    ("now", "gigabytes", "state", "reason"),
    [
        (99.0, 3, "", ""),
        (101.0, 3, "timeout", "too long"),
        (51.0, 3, "timeout", "too quiet"),
        (99.0, 2, "failed", "its processes took 3.00 GB, more than --memory 2 allows; see log.txt; allow more, or"),
    ],
    ids=["in time", "too long", "silent", "too large"],
)
def test_a_cell_past_its_limit_is_killed_with_the_reason(
    cells: Sequence[Cell], now: float, gigabytes: float, state: str, reason: str
) -> None:
    limits = Limits(None, memory=1e9 * gigabytes)
    limit = replace(limits.of(cells[0]), seconds=100.0, silence=50.0, sentence="too long", silent="too quiet")
    heard = 0.0 if reason == "too quiet" else 90.0
    job = _Job(cells[0], Hanging(), 1, 0.0, heard)  # type: ignore[arg-type]
    assert job.has_ended(limit, now) == bool(reason)
    assert (job.over.state if job.over else "") == state
    assert (job.over.reason if job.over else "").startswith(reason)
