"""A command on a run folder: which cells it runs, and which it can only skip."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from causalbench.cli.progress import QuietView
from causalbench.plugins.manager import Plugins, load_plugins
from causalbench.report.tables import write_tables
from causalbench.run.cell import Keeping
from causalbench.run.session import Execution, run_plan, status_in, to_do
from causalbench.store.run_folder import RunFolder
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


@pytest.fixture
def plugins() -> Plugins:
    """The installed ones, and a backend whose robot does not drive."""
    found = load_plugins()
    kinematic = found.backends["kinematic"]
    standing = dataclasses.replace(kinematic, name="standing", variants=kinematic.variants[:1])
    return dataclasses.replace(
        found,
        backends=found.backends | {"standing": standing},
        owners=found.owners | {"standing": found.owners["kinematic"]},
    )


def test_a_backend_that_cannot_run_the_task_is_skipped_and_the_rest_runs(
    tiny_suite: Path, plugins: Plugins, tmp_path: Path
) -> None:
    path = tmp_path / "suite.yaml"
    text = tiny_suite.read_text().replace("[kinematic]", "[standing, kinematic]").replace("cmSAC, ", "")
    path.write_text(text.replace("pure_manipulation", "mobile_manipulation"))
    file = load_suite(path, plugins)
    plan, run = make_plan(file, "smoke", plugins), RunFolder(tmp_path / "run")
    standing, kinematic = plan.cells
    assert to_do(plan, run, retry=True) == [kinematic]
    assert status_in(plan, run, standing).state == "skipped"  # known before anything has run
    execution = Execution("serial", 1, None, False, Keeping())
    run_plan(plan, run, file, plugins, execution, QuietView(), lambda: write_tables(run))
    assert (run.status(kinematic).state, run.status(standing).state) == ("done", "skipped")
    reason = run.status(standing).reason
    assert reason.startswith("backend 'standing' cannot run task 'mobile_manipulation'")
    assert [cell.backend.name for cell in to_do(plan, run, retry=True)] == []
    assert "standing" in (run.path / "leaderboard.csv").read_text()
