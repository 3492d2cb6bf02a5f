"""Rows of a run's tables that no run of the other tests has."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from stored import episode, finished

from causalbench.core.discovery.edges import edge_rows
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.records import Evaluation
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.report.frames import load_results
from causalbench.report.tables import result_rows, write_tables
from causalbench.store.cells import Status, StoredCell
from causalbench.store.records import Counts
from causalbench.store.run_folder import RunFolder


def test_an_edge_says_whether_the_policy_sets_its_action():
    human = manual_graph(TASK)
    last = human.stages[3]
    causes = dataclasses.replace(last, matrix=np.ones_like(last.matrix))
    for graph, expected in ((causes, 7 * [1]), (dataclasses.replace(causes, sufficient=("grip",)), 6 * [0] + [1])):
        rows = list(edge_rows(dataclasses.replace(human, stages=(graph,))))
        assert [row["in_policy"] for row in rows] == expected
        assert [row["selected"] for row in rows] == 7 * [1]


class _Cell(StoredCell):
    """A finished cell whose files are given."""

    def __init__(self, budget, successes, every=100):
        identity = {"kind": "learner", "task": {"name": "t"}, "backend": {"name": "b"}, "method": {"name": "m"}}
        identity |= {"seed": 0, "grid_point": {}, "env_steps": budget}
        super().__init__("cell", identity, Status("done", source="causalbench=a"), Path("nowhere"))
        steps = [every * (i + 1) for i in range(len(successes))]
        found = zip(steps, successes, strict=True)
        looks = [Evaluation(step, 10, success, 0.5, None, 0.0, 1.0, 1.0, {}) for step, success in found]
        counts = Counts(steps[-1], 1, 1, 0, 0, [], {}, {}, "", 0)
        self.evaluations, self.counts = lambda: looks, lambda: counts


@pytest.mark.parametrize(
    ("budget", "successes", "auc", "steps_to_90", "stopped_at"),
    [
        (400, [0.0, 0.5, 1.0, 0.8], (0.25 + 0.75 + 0.9) / 4, 300, None),
        # Stopped at half of the budget: the curve goes on at its last value.
        (400, [1.0, 0.8], (0.5 + 0.9 + 0.8 + 0.8) / 4, 100, 200),
        (200, [0.0, 0.8], 0.4 / 2, None, None),
    ],
)
def test_a_row_has_the_area_at_its_budget_and_says_where_it_was_stopped(
    budget, successes, auc, steps_to_90, stopped_at
):
    (row,) = result_rows([_Cell(budget, successes)])
    assert row["success_auc"] == pytest.approx(auc)
    assert (row["budget"], row["steps_to_90"], row["stopped_at"]) == (budget, steps_to_90, stopped_at)
    assert (row["success_deterministic"], row["best_success"]) == (successes[-1], max(successes))


def test_the_episodes_of_all_cells_stand_in_one_table_with_their_account(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    with run.claim():
        finished(run, episodes=[episode("1x2 2x3 1x4", 1), episode("1x2 2x1 3x1", 4, episode=1)])
        finished(run, seed=1)  # of a learner that keeps none
        write_tables(run)
    found = load_results(run.path)
    assert found.episodes["stages"].tolist() == ["1x2 2x3 1x4", "1x2 2x1 3x1"]
    assert found.episodes["return_r_a"].tolist() == [-1.0, -1.0]
    account = found.stage_account.set_index("stage")
    assert account["episodes_reached"].tolist() == [2, 2, 1, 1]
    assert account["episodes_lost"].tolist() == [0, 1, 0, 0]
    assert found.moves["count"].sum() == 13
    assert found.latching["points"].max() == 50.0
    for name in ("episodes", "stage_account", "moves", "progress_account", "latching"):
        assert (run.path / f"{name}.csv").read_text().count("\n") == len(getattr(found, name)) + 1
