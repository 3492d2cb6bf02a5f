"""`causalbench transfer`: policies on backends that they were not trained on."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import causalbench
from causalbench.core.learners.evaluation import Player, summary
from causalbench.core.learners.policy import load_policy
from causalbench.plugins.backends import Backend
from causalbench.plugins.manager import installed
from causalbench.registration import make_env
from causalbench.report.html import transfer
from causalbench.report.html.source import read_source
from causalbench.run import policies
from causalbench.store.cells import StoredCell
from causalbench.store.run_folder import RunFolder


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> RunFolder:
    shutil.copytree(finished_run, tmp_path / "run")
    return RunFolder(tmp_path / "run")


@pytest.fixture
def twin(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run has a cell on a backend `twin` that is kinematic by another name."""
    found = installed()
    backends: dict[str, Backend] = {**found.backends, "twin": found.backends["kinematic"]}
    monkeypatch.setattr(policies, "installed", lambda: dataclasses.replace(found, backends=backends))
    real = RunFolder.cells

    def cells(self: RunFolder) -> list[StoredCell]:
        here = real(self)
        place = here[0].identity["backend"] | {"name": "twin"}
        other = here[0].identity | {"backend": place, "kind": "discovery"}
        return [*here, dataclasses.replace(here[0], identity=other)]

    monkeypatch.setattr(RunFolder, "cells", cells)


def test_a_policy_plays_elsewhere_as_it_would_at_home(run: RunFolder, twin: None, cli: Callable) -> None:
    done = cli("transfer", run.path, "--episodes", "2", "--only", "method=mSAC")
    assert (done.returncode, done.stderr) == (0, "")
    (cell,) = [cell for cell in run.cells() if cell.method == "mSAC"]
    (row,) = cell.beside("transfer.csv")
    worlds = make_env("pure_manipulation", "kinematic").make_worlds(1)
    player, policy = Player(worlds, cell.identity["evaluation"]["first_start"]), load_policy(cell.policy_folder())
    certain, sampled = (player.play(policy, range(2), mode) for mode in (True, False))
    own = summary(0, certain, sampled, sum(episode.success for episode in sampled) / 2)
    assert row["played_on"] == "twin"
    for name in ("episodes", "success_deterministic", "success_sampled", "reversals_per_episode", "mean_final_stage"):
        assert row[name] == getattr(own, name)
    assert list(causalbench.load_results(run.path).transfer["played_on"]) == ["twin"]


def test_a_run_on_one_backend_has_nowhere_else_to_play(run: RunFolder, cli: Callable) -> None:
    done = cli("transfer", run.path)
    assert done.returncode == 2
    assert "all of it is on kinematic; a transfer needs a run on several backends" in done.stderr


def test_the_page_has_the_place_of_training_beside_that_of_playing(run: RunFolder, twin: None, cli: Callable) -> None:
    (note,) = transfer.section(read_source(run.path)).blocks
    assert note.text == "Not played yet: causalbench transfer run"
    cli("transfer", run.path, "--episodes", "1")
    (table,) = transfer.section(read_source(run.path)).blocks
    assert [column.name for column in table.columns] == ["method", "trained on", "seeds", "kinematic", "twin"]
    assert [row.values[0].text for row in table.rows] == ["cmSAC", "mSAC"]
    assert table.rows[0].values[3].text == "0.00 (0.00 to 0.00)"
