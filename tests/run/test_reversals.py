"""`causalbench reversals`: the account of a finished run's reversals, and how it comes into its tables."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import pytest
from stored import discovered, finished

import causalbench
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import RunFolderError
from causalbench.run.reversals import graph_for
from causalbench.store.beside import REVERSALS
from causalbench.store.run_folder import RunFolder


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> RunFolder:
    shutil.copytree(finished_run, tmp_path / "run")
    return RunFolder(tmp_path / "run")


def test_the_account_lies_beside_each_cell_and_in_the_runs_tables(run: RunFolder, cli) -> None:
    before = causalbench.load_results(run.path)
    assert before.reversals.empty
    done = cli("reversals", run.path, "--episodes", "1")
    assert (done.returncode, done.stderr) == (0, "")
    cells = [cell for cell in run.cells() if cell.is_done("learner")]
    assert len(done.stdout.splitlines()) == len(cells)
    table = causalbench.load_results(run.path).reversals
    assert set(table["method"]) == {cell.method for cell in cells}
    steps = table.groupby(["method", "seed", "deterministic", "episode"])["steps_in_stage"].sum()
    played = before.episodes.set_index(["method", "seed", "deterministic", "episode"])["length"]
    certain = steps[steps.index.get_level_values("deterministic") == 1]
    assert (certain == played[certain.index]).all()  # the same episodes as the last evaluation's
    assert (run.path / REVERSALS).read_text().startswith("task,backend,method,grid_point,seed,episode,")
    assert not run.problems()  # no result of a cell has changed
    assert not [cell for cell in run.cells() if cell.status.state == "damaged"]


def test_the_causes_are_those_that_the_run_discovered_for_the_seed(run: RunFolder) -> None:
    cells = run.cells()
    (cell, *_) = [cell for cell in cells if cell.is_done("learner")]
    found = [other for other in cells if other.is_done("discovery")]
    assert graph_for(cell, cells).hash in {other.graph().hash for other in found}
    assert graph_for(cell, [cell]).origin == "manual"


def test_of_several_discoverers_it_is_the_methods_own_or_else_the_suites(tmp_path: Path) -> None:
    run, graphs = RunFolder(tmp_path), {}
    for discoverer in ("kl", "paired"):
        for seed in (3, 4):
            graph = dataclasses.replace(manual_graph(TASK), origin="discovered", env_steps=10 * seed + len(discoverer))
            cell = discovered(run, graph, seed=seed, settings={"discoverer": discoverer})
            graphs[discoverer, seed] = (cell.id, graph.hash)
    named = {"name": "cm-kl", "learner": "SAC", "discoverer": "kl"}
    for seed in (3, 4):
        finished(run, seed=seed, method=named, discovery=graphs["kl", seed][0])
        finished(run, seed=seed, method={"name": "cm", "learner": "SAC"}, discovery=graphs["paired", seed][0])
    finished(run, seed=4, method={"name": "m", "learner": "SAC"})
    cells = run.cells()
    found = {(c.method, c.seed): graph_for(c, cells).hash for c in cells if c.is_done("learner")}
    assert found["cm-kl", 4] == graphs["kl", 4][1]
    assert found["cm", 3] == graphs["paired", 3][1]
    assert found["m", 4] == graphs["paired", 4][1]


def test_a_damaged_account_is_named(run: RunFolder) -> None:
    (cell, *_) = [cell for cell in run.cells() if cell.is_done("learner")]
    (cell.folder / REVERSALS).write_text("episode,deterministic\n1,x\n")
    with pytest.raises(RunFolderError, match=r"reversals\.csv"):
        causalbench.load_results(run.path)
