"""A run folder with a bit of everything, made in a moment; what strings it holds are hostile where they may be any."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
from stored import LEARNER, PlannedCell, discovered, episode, finished

import causalbench
from causalbench.core.discovery.graph import CausalGraph, EvidenceColumn, manual_graph
from causalbench.core.learners.records import ReversalCauses
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.report.html.source import Source, read_source
from causalbench.store.beside import REVERSALS, write_beside
from causalbench.store.cells import LOG, Status
from causalbench.store.claim import own_folder
from causalbench.store.films import VIDEOS, Film, write_film
from causalbench.store.run_folder import RunFolder
from causalbench.suite.hypotheses import Statement

HOSTILE = """</script><script>boom()</script><img src=x onerror='boom()'>"'`]]>--><!--{{ 7*7 }} $x_1$ \\ & | % #"""
"""What a stranger may write into a log, a reason, a setting or a note."""
AREAS = {"cm": (0.9, 0.8, 1.0, 0.9, 0.7), "m": (0.1, 0.0, 0.2, 0.1, 0.0)}
"""Method -> final success of its seeds."""
BACKENDS = ("kinematic", "physical")


def found_graph(hostile: str = HOSTILE) -> CausalGraph:
    """The human's graph of pure manipulation without armx's first edge, with evidence and a note."""
    human = manual_graph(TASK)
    first = human.stages[0].matrix.copy()
    first[0] = False
    stages = [dataclasses.replace(human.stages[0], matrix=first, notes=(hostile,)), *human.stages[1:]]
    shown = [dataclasses.replace(stage, evidence={"kl": np.where(stage.matrix, 2.0, 0.01)}) for stage in stages]
    columns = (EvidenceColumn("kl", "nats", hostile, main=True, log_range=(1e-4, 12.5)),)
    return dataclasses.replace(human, origin="discovered", stages=tuple(shown), env_steps=40, columns=columns)


def oracle_table() -> str:
    """An oracle that grades what the human declares strong, all else absent."""
    lines = ["stage,term,action,effect,effect_low,effect_high,floor,grade,selected"]
    for stage in manual_graph(TASK).stages:
        for j, term in enumerate(stage.terms):
            for k, action in enumerate(stage.actions):
                numbers = "0.5,0.4,0.6,0.0,strong" if stage.matrix[k, j] else "0.0,0.0,0.0,0.0,absent"
                lines.append(f"{stage.stage},{term},{action},{numbers},0")
    return "\n".join(lines) + "\n"


def _account(folder: Path, seed: int) -> None:
    """Four episodes with two reversals each, of which both vanish without redundant actions if the seed is even."""
    vanished = 2 if seed % 2 == 0 else 0
    rows = [ReversalCauses(number, True, 2, 9, 2, 2, vanished, 0) for number in range(4)]
    write_beside(folder, REVERSALS, rows)


def _film(run: RunFolder, cell: str) -> None:
    """Three seconds of a film: two in stage 1, one in stage 2."""
    path = own_folder(run.path / VIDEOS) / f"{cell}.mp4"
    with imageio.get_writer(path, fps=10, codec="libx264") as writer:
        for frame in range(30):
            writer.append_data(np.full((48, 64, 3), 8 * frame, dtype=np.uint8))
    write_film(path, Film(10.0, 3, "1x20 2x10"))


@pytest.fixture(scope="session")
def shown_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two methods on two backends with five seeds, discoveries, a failure, a skipped cell; tests must not change it."""
    run = RunFolder(tmp_path_factory.mktemp("shown") / "run")
    run.path.mkdir()
    run.state(Statement("s", "t", ("cm > m", "m == cm within 0.1"), BACKENDS, tuple(range(5))))
    episodes = [episode("1x2 2x2 1x1 2x3", final_stage=4), episode("1x4 2x2", final_stage=1, episode=1)]
    for backend in BACKENDS:
        place = {"backend": {"name": backend, "version": "1"}}
        for method, areas in AREAS.items():
            named = {"method": {"name": method, "learner": "SAC", "control": "none", "matrix": "none"}}
            for seed, success in enumerate(areas):
                cell = finished(run, success, episodes, seed=seed, **place, **named)
                if backend == "physical":
                    _account(run.folder(cell), seed)
        for seed in range(2):
            discovered(run, found_graph() if seed else None, oracle_table(), seed=seed, **place)
    gridded = {"method": {"name": "m", "learner": "SAC"}, "grid_point": {"learner.note": HOSTILE}}
    finished(run, 0.3, episodes, **gridded, backend={"name": "kinematic", "version": "1"})
    unlucky = {"method": {"name": "unlucky", "learner": "SAC"}, "backend": {"name": "physical", "version": "1"}}
    failing = PlannedCell(LEARNER | unlucky)
    (run.start(failing) / LOG).write_text(f"before\n{HOSTILE}\n")
    run.finish(failing, Status("failed", f"ended with {HOSTILE}"))
    run.finish(PlannedCell(LEARNER | {"seed": 8}), Status("skipped", "the robot does not drive"))
    _film(run, next(cell.id for cell in run.cells() if (cell.method, cell.backend) == ("cm", "physical")))
    run.add_session({"command": ["causalbench", HOSTILE], "cpu": HOSTILE, "known_gaps": {"physical": {"S9": HOSTILE}}})
    (run.path / "suite.yaml").write_text(json.dumps(HOSTILE))
    return run.path


@pytest.fixture(scope="session")
def written(shown_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a copy of the run."""
    folder = tmp_path_factory.mktemp("written") / "run"
    shutil.copytree(shown_run, folder)
    return causalbench.write_report(folder)


@pytest.fixture(scope="session")
def source(shown_run: Path) -> Source:
    """What a page of that run is made from."""
    return read_source(shown_run)
