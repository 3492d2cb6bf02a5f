"""What a person sees while cells run."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest
from rich.console import Console

from causalbench.cli.progress import LineView, TableView, choose_view
from causalbench.plugins.manager import load_plugins
from causalbench.run.cell import Progress
from causalbench.run.view import Silent
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


@pytest.fixture
def cells(tiny_suite: Path) -> tuple[Cell, ...]:
    return make_plan(load_suite(tiny_suite, load_plugins()), "smoke", load_plugins()).cells


def console(terminal: bool) -> Console:
    return Console(file=io.StringIO(), force_terminal=terminal, width=160, color_system=None)


def shown(view: LineView | TableView, cells: tuple[Cell, ...], run: RunFolder, output: Console) -> str:
    view.begin(cells, cells[1:], run)
    view.on_progress(cells[1], Progress(0.5, "stage [2]", 0.25, 3.5))
    view.on_progress(cells[1], Progress(0.52, "stage [2]", 0.25, 3.5))
    view.on_outcome(cells[2], Status("failed", "the arm [fell] off", 2.0))
    view.end()
    assert isinstance(output.file, io.StringIO)
    return output.file.getvalue()


def test_the_view_fits_the_output() -> None:
    assert isinstance(choose_view(False, console(True)), TableView)
    assert isinstance(choose_view(False, console(False)), LineView)
    assert isinstance(choose_view(True, console(True)), Silent)


def test_a_terminal_shows_one_line_per_cell(cells: tuple[Cell, ...], tmp_path: Path) -> None:
    output = console(True)
    text = shown(TableView(output), cells, RunFolder(tmp_path), output)
    lines = {line.split("│")[1].strip(): line for line in text.splitlines() if line.count("│") > 6}
    assert [name for name in lines if "seed 0" in name] == [
        "discovery on kinematic, seed 0", "cmSAC on kinematic, seed 0", "mSAC on kinematic, seed 0"
    ]  # fmt: skip
    running = [cell.strip() for cell in lines["cmSAC on kinematic, seed 0"].split("│")]
    assert (running[2], running[4], running[5], running[7]) == ("running", "0.25", "3.50", "stage [2]")
    assert "the arm [fell] off" in lines["mSAC on kinematic, seed 0"]


def test_elsewhere_a_tenth_is_a_line(cells: tuple[Cell, ...], tmp_path: Path) -> None:
    output = console(False)
    assert shown(LineView(output), cells, RunFolder(tmp_path), output).splitlines() == [
        f"2 of 3 cells to run in {tmp_path}",
        "cmSAC on kinematic, seed 0: 50% stage [2], success 0.25, 3.50 reversals per 1000 steps",
        "mSAC on kinematic, seed 0: failed after 2.0 s: the arm [fell] off",
        "1 of 2 cells to go, about 0 s",
    ]


def test_the_time_left_is_that_of_the_cells_so_far(
    cells: tuple[Cell, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1_000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    output = console(False)
    view = LineView(output)
    view.begin(cells, cells, RunFolder(tmp_path))
    for took in (600.0, 1_400.0, 1.0):
        now[0] += took
        view.on_outcome(cells[0], Status("done", "", took))
    assert isinstance(output.file, io.StringIO)
    left = [line for line in output.file.getvalue().splitlines() if "to go" in line]
    assert left == ["2 of 3 cells to go, about 20 min", "1 of 3 cells to go, about 17 min"]
