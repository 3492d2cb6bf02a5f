"""`causalbench verify`: cells run again come out the same, and what was changed by hand does not go unnoticed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from causalbench.digests import file_digest


def verify(command: list[str], run: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*command, "verify", str(run), *arguments], capture_output=True, text=True)


@pytest.fixture
def changed_run(finished_run: Path, tmp_path: Path) -> Path:
    """A copy of the run in which mSAC claims a success that it did not have, with digests that fit the claim."""
    run = tmp_path / "changed"
    shutil.copytree(finished_run, run)
    (cell,) = (run / "cells").glob("*-mSAC-*")
    status: dict[str, Any] = json.loads((cell / "status.json").read_text())
    lines = (cell / "progress.csv").read_text().splitlines()
    last = dict(zip(lines[0].split(","), lines[-1].split(","), strict=True))
    (cell / "progress.csv").write_text(
        "\n".join([*lines[:-1], ",".join((last | {"mean_length": "7.0"}).values())]) + "\n"
    )
    status["files"]["progress.csv"] = file_digest(cell / "progress.csv")
    status["source"] = "0123456789abcdef-0123456789abcdef"
    (cell / "status.json").write_text(json.dumps(status))
    return run


def test_cells_that_are_run_again_agree_and_a_number_changed_by_hand_does_not(
    changed_run: Path, command: list[str]
) -> None:
    done = verify(command, changed_run, "--cells", "9", "--json")
    assert done.returncode == 1, done.stderr
    said = json.loads(done.stdout)
    found = {cell["cell"].split("-")[2]: (cell["agrees"], cell["differing"]) for cell in said["cells"]}
    assert found == {"s0": (True, []), "cmSAC": (True, []), "mSAC": (False, ["progress.csv"])}
    (result,) = (cell["result"] for cell in said["cells"] if not cell["agrees"])
    assert result == "success 0 then, 0 now, within the 95% intervals of 1 episodes"
    (changed,) = said["changed"]  # the machine and its packages are the same
    assert changed.startswith("the source code: 0123456789abcdef-0123456789abcdef, ")


@pytest.mark.long
def test_a_learner_alone_uses_the_graph_of_the_run_and_nothing_there_is_touched(
    finished_run: Path, command: list[str]
) -> None:
    before = {path: path.stat().st_mtime_ns for path in finished_run.rglob("*")}
    done = verify(command, finished_run, "--cells", "1", "--seed", "0", "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    assert "-cmSAC-s0-" in done.stdout
    assert "bit for bit the same" in done.stdout
    assert {path: path.stat().st_mtime_ns for path in finished_run.rglob("*")} == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "suite.yaml: missing, so"),
        ("seeds: 1", "none of its 3 finished cells is one that"),
    ],
)
def test_a_folder_that_cannot_be_verified_is_refused(
    finished_run: Path, command: list[str], tmp_path: Path, text: str | None, message: str
) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    if text is None:
        (run / "suite.yaml").unlink()
    else:
        suite = (run / "suite.yaml").read_text().replace("env_steps: 120", "env_steps: 240")
        (run / "suite.yaml").write_text(suite.replace("training_count: 20", "training_count: 21"))
    done = verify(command, run)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
