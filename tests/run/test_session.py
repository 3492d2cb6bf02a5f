"""A command on a run folder: which cells it runs, and which it can only skip."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from stacking import STACKING

from causalbench.core.world.capabilities import Capability
from causalbench.plugins.manager import Plugins, installed, load_plugins
from causalbench.report.tables import write_tables
from causalbench.run.cell import Keeping
from causalbench.run.session import Execution, run_plan, status_in, to_do
from causalbench.run.view import Silent
from causalbench.store.run_folder import RunFolder
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


@pytest.fixture
def plugins(monkeypatch: pytest.MonkeyPatch) -> Plugins:
    """The installed ones, a task with two objects, and a backend whose robot does not drive and that has one object."""
    found = load_plugins()
    # Where a cell looks up its task and whose it is.
    monkeypatch.setitem(installed().tasks, STACKING.name, STACKING)
    monkeypatch.setitem(installed().packages, ("tasks", STACKING.name), "causalbench")
    kinematic = found.backends["kinematic"]
    first = kinematic.variants[0]
    variant = dataclasses.replace(first, capabilities=first.capabilities - {Capability.SEVERAL_OBJECTS})
    standing = dataclasses.replace(kinematic, name="standing", variants=(variant,))
    return dataclasses.replace(
        found,
        tasks=found.tasks | {STACKING.name: STACKING},
        backends=found.backends | {"standing": standing},
        owners=found.owners | {"standing": found.owners["kinematic"]},
    )


@pytest.mark.parametrize(
    ("task", "lacked"), [("mobile_manipulation", "lidar, mobile_base"), ("stacking", "several_objects")]
)
def test_a_backend_that_cannot_run_the_task_is_skipped_and_the_rest_runs(
    task: str, lacked: str, tiny_suite: Path, plugins: Plugins, tmp_path: Path
) -> None:
    path = tmp_path / "suite.yaml"
    text = tiny_suite.read_text().replace("[kinematic]", "[standing, kinematic]").replace("cmSAC, ", "")
    path.write_text(text.replace("pure_manipulation", task))
    file = load_suite(path, plugins)
    plan, run = make_plan(file, "smoke", plugins), RunFolder(tmp_path / "run")
    standing, kinematic = plan.cells
    assert to_do(plan, run, retry=True) == [kinematic]
    assert status_in(plan, run, standing).state == "skipped"  # known before anything has run
    execution = Execution("serial", 1, None, False, Keeping())
    run_plan(plan, run, file, plugins, execution, Silent(), lambda: write_tables(run))
    assert (run.status(kinematic).state, run.status(standing).state) == ("done", "skipped")
    reason = run.status(standing).reason
    assert reason.startswith(f"backend 'standing' cannot run task '{task}'")
    assert lacked in reason
    assert [cell.backend.name for cell in to_do(plan, run, retry=True)] == []
    assert "standing" in (run.path / "leaderboard.csv").read_text()
