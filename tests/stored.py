"""Cells without a suite, for tests of the store."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.learners.records import Episode, Evaluation, TrainingCounts
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.store.cells import Status
from causalbench.store.episodes import stage_trace, write_episodes
from causalbench.store.records import write_counts, write_progress
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import cell_id

SHARED: dict[str, Any] = {
    "code": "1", "task": {"name": "t", "version": 0}, "backend": {"name": "b", "version": "1"}, "seed": 0,
    "grid_point": {},
}  # fmt: skip
LEARNER = SHARED | {
    "kind": "learner", "method": {"name": "m", "learner": "SAC"}, "env_steps": 100, "learner": {"gamma": 0.9},
    "evaluation": {"every": 10}, "discovery": None,
}  # fmt: skip
DISCOVERY = SHARED | {"kind": "discovery", "settings": {"discoverer": "kl"}}


@dataclass
class PlannedCell:
    """A cell as a plan has it."""

    identity: dict[str, Any]

    @property
    def id(self) -> str:
        return cell_id(self.identity)


def finished(run: RunFolder, success: float = 0.5, episodes: Sequence[Episode] = (), **changes: Any) -> PlannedCell:
    """A learner cell that is done in `run`; `changes` are of its identity."""
    cell = PlannedCell(LEARNER | changes)
    folder = run.start(cell)
    write_progress(folder / "progress.csv", [evaluation(50, 0.0), evaluation(100, success)])
    counts = TrainingCounts(np.zeros((3, 3), dtype=np.int64), 100, 8, reached={1: 2, 2: 1})
    write_counts(folder / "counts.json", counts, None)
    write_episodes(folder / "episodes.csv", episodes)
    (folder / "policy").mkdir()
    (folder / "policy" / "policy.json").write_text(json.dumps({"success": success}))
    run.finish(cell, Status("done", "", 1.5, 100))
    return cell


def discovered(run: RunFolder, graph: CausalGraph | None = None, oracle: str = "", **changes: Any) -> PlannedCell:
    """A discovery cell that is done in `run`: it found `graph`, or the human's, and `oracle` is its oracle.csv."""
    cell = PlannedCell(DISCOVERY | changes)
    folder = run.start(cell)
    human = manual_graph(TASK)
    (folder / "graph.json").write_text((graph or human).to_json())
    (folder / "manual.json").write_text(human.to_json())
    if oracle:
        (folder / "oracle.csv").write_text(oracle)
    (folder / "evidence.csv").write_text("stage\n1\n")
    run.finish(cell, Status("done", "", 1.5, 100))
    return cell


def evaluation(env_steps: int, success: float) -> Evaluation:
    """One of a training run."""
    return Evaluation(env_steps, 4, success, success, None, 0.0, 1.5, 7.0, {"r_a": -1.0})


def episode(stages: str, final_stage: int, n_stages: int = 3, held: bool | None = None, **changes: Any) -> Episode:
    """An episode with this stage trace, such as "1x3 2x5"; a success if `final_stage` is the one after the last."""
    trace, success = stage_trace(stages), final_stage > n_stages
    made = Episode(0, True, success, held, n_stages, trace, final_stage, {"r_a": -1.0, "r_b": 0.25})
    return dataclasses.replace(made, **changes)
