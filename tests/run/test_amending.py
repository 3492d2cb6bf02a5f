"""A suite that asks for more than its run folder holds: only what is new runs, and a larger budget goes on."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from runs import results

from causalbench.store.run_folder import RunFolder

SMALL, LARGE = "smoke: {seeds: 1, env_steps: 70}", "smoke: {seeds: 1, env_steps: 130}"


@pytest.fixture(scope="module")
def suite(tiny_suite: Path) -> Callable[[str, str], str]:
    """A function (methods, tier) to the text of the suite."""
    text = tiny_suite.read_text().replace("smoke: {seeds: 1, env_steps: 120}", "TIER").replace("cmSAC, mSAC", "METHODS")
    return lambda methods, tier: text.replace("METHODS", methods).replace("TIER", tier)


@pytest.fixture
def run(cli: Callable, tmp_path: Path) -> Callable[[str, str], str]:
    """A function (text of a suite, folder) that runs it and returns what was said."""

    def call(text: str, out: str) -> str:
        path = tmp_path / "suite.yaml"
        path.write_text(text)
        done = cli("run", str(path), "--tier", "smoke", "--out", str(tmp_path / out), "--executor", "serial")
        assert done.returncode == 0, done.stderr
        return done.stderr

    return call


def logs(run: Path) -> dict[tuple[str, int], str]:
    """(method, budget) -> its log."""
    cells = [path.parent for path in run.glob("cells/*/cell.json")]
    told = {cell: json.loads((cell / "cell.json").read_text()) for cell in cells}
    return {(t["method"]["name"], t["env_steps"]): (cell / "log.txt").read_text() for cell, t in told.items()}


@pytest.mark.long
def test_a_larger_budget_goes_on_to_the_bytes_of_a_run_from_the_start(
    suite: Callable, run: Callable, tmp_path: Path
) -> None:
    """An agent of stable-baselines3 keeps nothing to go on from. A grown run holds the small cells as they were."""
    run(suite("mSAC, SAC", SMALL), "grown")
    small = {name: content for name, content in results(tmp_path / "grown").items() if name.startswith("cells")}
    said = run(suite("mSAC, SAC", LARGE), "grown")
    run(suite("mSAC, SAC", LARGE), "whole")
    grown, whole = results(tmp_path / "grown"), results(tmp_path / "whole")
    assert {name: grown.pop(name) for name in small} == small
    assert {k: v for k, v in grown.items() if k != "hypotheses.json"} == {
        k: v for k, v in whole.items() if k != "hypotheses.json"
    }
    assert "2 cells of a smaller budget stay" in said
    assert "1 cells go on from where their smaller budget ended" in said
    assert "-SAC-s0-" in next(
        line for line in said.splitlines() if "starts over: that of 70 steps left no chec" in line
    )
    assert "continued from the checkpoint at step 70" in logs(tmp_path / "grown")["mSAC", 130]


@pytest.mark.long
def test_what_a_folder_has_is_not_run_again_when_a_suite_gets_more(
    suite: Callable, run: Callable, tmp_path: Path
) -> None:
    first, more = suite("mSAC", SMALL), suite("mSAC, cSAC", SMALL.replace("seeds: 1", "seeds: 2"))
    run(first, "grown")
    before = results(tmp_path / "grown")
    said = run(more, "grown")
    assert "3 of 4 cells to run" in said
    after = results(tmp_path / "grown")
    assert {name: after[name] for name in before if name.startswith("cells")} == {
        name: content for name, content in before.items() if name.startswith("cells")
    }
    assert len(RunFolder(tmp_path / "grown").cells()) == 4


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda cell: (cell / "checkpoint.safetensors").unlink(), "left no checkpoint"),
        pytest.param(
            lambda cell: edited(cell / "status.json", source="causalbench=0"),
            "was made by other source code",
            marks=pytest.mark.long,
        ),
        pytest.param(lambda cell: edited(cell / "status.json", state="failed"), "is failed", marks=pytest.mark.long),
    ],
    ids=["no checkpoint", "other code", "failed"],
)
def test_a_cell_that_cannot_go_on_says_why_and_starts_over(
    damage: Callable, reason: str, suite: Callable, run: Callable, tmp_path: Path
) -> None:
    run(suite("mSAC", SMALL), "grown")
    damage(next((tmp_path / "grown" / "cells").iterdir()))
    said = run(suite("mSAC", LARGE), "grown")
    assert f"starts over: that of 70 steps {reason}" in said
    assert "continued" not in logs(tmp_path / "grown")["mSAC", 130]


def edited(path: Path, **changes: str) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_a_smaller_budget_or_other_settings_beside_a_larger_one_are_refused(
    suite: Callable, run: Callable, cli: Callable, tmp_path: Path
) -> None:
    run(suite("mSAC", SMALL), "run")
    shutil.copytree(tmp_path / "run", tmp_path / "before")
    for text, word in [
        (suite("mSAC", SMALL).replace("70", "60"), "the budget on kinematic"),
        (suite("mSAC", LARGE).replace("learning_starts: 20", "learning_starts: 21"), "learning_starts"),
    ]:
        (tmp_path / "other.yaml").write_text(text)
        done = cli("run", str(tmp_path / "other.yaml"), "--tier", "smoke", "--out", str(tmp_path / "run"))
        assert done.returncode == 2
        assert word in done.stderr
    assert results(tmp_path / "run") == results(tmp_path / "before")
