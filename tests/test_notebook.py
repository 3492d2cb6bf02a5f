"""The notebook that reads a run does what it says, on a run."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "read_a_run.ipynb"


def programs() -> list[str]:
    """The code of each cell."""
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def test_every_cell_runs_on_a_run(finished_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    shutil.copytree(finished_run, "runs/pure_manip-quick")
    names: dict[str, Any] = {}
    for program in programs():
        exec(compile(program, str(NOTEBOOK), "exec"), names)
    assert set(names["results"].leaderboard["method"]) == {"cmSAC", "mSAC"}
    assert list(names["curves"].index) == [60, 120]
    assert (tmp_path / "runs/pure_manip-quick/report.html").stat().st_size > 100_000


def test_it_was_saved_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
