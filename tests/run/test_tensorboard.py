"""`causalbench run --tensorboard`: curves that TensorBoard reads, and a clear error without it."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.run.cell import Keeping, run_cell
from causalbench.run.tensorboard import summary_writer
from causalbench.store.records import read_progress
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import LearnerCell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


def test_without_the_package_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("torch.utils.tensorboard")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    with pytest.raises(UserError, match=r"pip install 'causalbench-robotics\[tensorboard\]'"):
        summary_writer()


def test_the_curves_are_those_of_progress_csv(finished_run: Path, tiny_suite: Path, tmp_path: Path) -> None:
    pytest.importorskip("tensorboard", reason="the extra tensorboard is not installed")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run = RunFolder(tmp_path / "run")
    shutil.copytree(finished_run, run.path)
    plan = make_plan(load_suite(tiny_suite, installed()), "smoke", installed())
    cell = next(cell for cell in plan.cells if isinstance(cell, LearnerCell) and cell.method.name == "mSAC")
    folder = run.start(cell)
    assert run_cell(cell, run, lambda progress: None, Keeping(tensorboard=True)).state == "done"
    board = EventAccumulator(str(folder / "tensorboard")).Reload()
    evaluations = read_progress(folder / "progress.csv")
    for name, expected in (
        ("evaluation/mean_final_stage", [e.mean_final_stage for e in evaluations]),
        ("return/r_eefx", [e.term_returns["r_eefx"] for e in evaluations]),
    ):
        points = board.Scalars(name)
        assert [point.step for point in points] == [e.env_steps for e in evaluations]
        assert [point.value for point in points] == pytest.approx(expected)
