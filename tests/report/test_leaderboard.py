"""The leaderboard: order, verdicts and what is said about cells that failed."""

from __future__ import annotations

from pathlib import Path

import pytest

from causalbench.report.columns import TABLES
from causalbench.report.leaderboard import leaderboard
from causalbench.store.cells import State, Status, StoredCell
from causalbench.store.statements import Stated
from causalbench.suite.hypotheses import Statement


def cell(method: str, seed: int, backend: str = "toy", state: State = "done", **grid_point: float) -> StoredCell:
    identity = {"kind": "learner", "backend": {"name": backend}, "method": {"name": method}, "seed": seed}
    identity |= {"grid_point": grid_point}
    return StoredCell(f"{backend}-{method}-{seed}", identity, Status(state), Path("nowhere"))


def result(method: str, seed: int, auc: float, backend: str = "toy", **more) -> dict:
    return {
        "method": method, "grid_point": "", "backend": backend, "seed": seed,
        "budget": 5000, "success_auc": auc, "success_deterministic": auc, "success_sampled": auc,
        "best_success": auc, "stopped_at": None,
        "held_rate": None, "steps_to_90": 1000, "discovery_env_steps": 0, "reversals_per_1000_steps": 1.0,
        "source": "causalbench=a sim=x",
    } | more  # fmt: skip


def board(scores: dict[str, list[float]], backend: str = "toy") -> list[dict]:
    results = [result(m, s, auc, backend) for m, values in scores.items() for s, auc in enumerate(values)]
    return leaderboard(results, [cell(row["method"], row["seed"], backend) for row in results], [])


def test_a_board_says_how_many_versions_of_the_code_made_it() -> None:
    def sources(*of: tuple[str, str, str]) -> dict[str, int]:
        results = [result(method, 0, 0.5, backend, source=source) for method, backend, source in of]
        rows = leaderboard(results, [cell(method, 0, backend) for method, backend, _ in of], [])
        return {row["backend"]: row["sources"] for row in rows}

    of_each = ("A", "x", "causalbench=a x=1"), ("A", "y", "causalbench=a y=2")  # every backend has a plugin of its own
    assert sources(*of_each) == {"all": 1, "x": 1, "y": 1}
    assert sources(*of_each, ("B", "x", "causalbench=a other=1 x=1")) == {"all": 1, "x": 1, "y": 1}  # so has a method
    assert sources(*of_each, ("B", "x", "causalbench=a x=2")) == {"all": 2, "x": 2, "y": 1}
    assert sources(*of_each, ("B", "x", "causalbench=b x=1")) == {"all": 2, "x": 2, "y": 1}
    assert sources(of_each[0], ("A", "y", "causalbench=b y=2")) == {"all": 2, "x": 1, "y": 1}


def test_backends_of_different_budgets_have_no_board_together() -> None:
    cells = [cell("A", 0, "x"), cell("A", 0, "y")]
    for budget, boards in ((5000, ["all", "x", "y"]), (600, ["x", "y"])):
        results = [result("A", 0, 0.5, "x"), result("A", 0, 0.5, "y", budget=budget)]
        assert [row["backend"] for row in leaderboard(results, cells, [])] == boards


def test_one_seed_gives_an_order_and_no_verdict() -> None:
    rows = board({"A": [0.2], "B": [0.7]})
    assert [(r["rank"], r["method"], r["verdict"]) for r in rows] == [
        (1, "B", "1 seed cannot tell anything apart"),
        (1, "A", "nothing is ranked below"),
    ]
    assert rows[0]["worst_rank"] == 2
    assert set(rows[0]) <= set(TABLES["leaderboard.csv"])


def test_each_variant_of_a_grid_is_ranked_by_itself() -> None:
    scores = {0.9: 0.2, 0.99: 0.7}
    results = [result("A", s, auc, grid_point=f"gamma={g}") for g, auc in scores.items() for s in range(5)]
    cells = [cell("A", seed, gamma=gamma) for gamma in scores for seed in range(5)]
    rows = leaderboard(results, cells, [])
    assert [(row["rank"], row["method"], row["grid_point"], row["seeds"], row["failed_cells"]) for row in rows] == [
        (1, "A", "gamma=0.99", 5, 0),
        (2, "A", "gamma=0.9", 5, 0),
    ]
    assert rows[0]["verdict"] == "better than A (gamma=0.9)"


def test_three_seeds_are_too_few() -> None:
    rows = board({"A": [0.1] * 3, "B": [0.9] * 3})
    assert [(row["rank"], row["worst_rank"]) for row in rows] == [(1, 2), (1, 2)]
    assert rows[0]["verdict"] == "3 seeds cannot tell anything apart"
    assert board({"A": [0.1] * 4, "B": [0.9] * 4})[0]["verdict"] == "better than A"


def test_five_seeds_separate_what_never_overlaps() -> None:
    rows = board(
        {
            "low": [0.1, 0.2, 0.15, 0.12, 0.18],
            "high": [0.8, 0.9, 0.85, 0.82, 0.88],
            "high2": [0.81, 0.89, 0.85, 0.82, 0.87],
        }
    )
    assert [(r["rank"], r["worst_rank"], r["method"], r["verdict"]) for r in rows] == [
        (1, 2, "high", "not told apart from high2"),
        (1, 2, "high2", "better than low"),
        (3, 3, "low", "nothing is ranked below"),
    ]
    assert rows[1]["p_better_than_next"] == 1.0
    assert rows[0]["success_auc_iqm"] == pytest.approx((0.82 + 0.85 + 0.88) / 3)
    assert (rows[0]["success_auc_lowest"], rows[0]["success_auc_highest"]) == (0.8, 0.9)
    assert rows[0]["tolerance"] == pytest.approx(0.3426, abs=1e-4)


def test_steps_to_90_is_a_median_with_never_as_infinity_and_discovery_is_added() -> None:
    steps = [1000, None, 3000]
    results = [result("A", s, 0.5, steps_to_90=n, discovery_env_steps=50) for s, n in enumerate(steps)]
    row = leaderboard(results, [cell("A", s) for s in range(3)], [])[0]
    assert (row["steps_to_90"], row["steps_to_90_with_discovery"]) == (3000, 3050)
    results = [result("A", s, 0.5, steps_to_90=n) for s, n in enumerate([1000, None, None])]
    (row,) = leaderboard(results, [cell("A", s) for s in range(3)], [])
    assert (row["steps_to_90"], row["reached_90"], row["budget"]) == (None, 1, 5000)


def test_survivors_are_not_ranked_and_every_planned_cell_counts() -> None:
    cells = [cell("A", 0), cell("A", 1, state="failed"), cell("B", 0, state="diverged"), cell("B", 1, state="pending")]
    cells += [cell("C", 0), cell("C", 1)]
    results = [result("A", 0, 0.9), result("C", 0, 0.5), result("C", 1, 0.5)]
    rows = leaderboard(results, cells, [])
    assert [(r.get("rank"), r["method"], r["seeds"], r["failed_cells"]) for r in rows] == [
        (1, "C", 2, 0),
        (None, "A", 1, 1),
        (None, "B", 0, 1),
    ]
    assert rows[1]["verdict"] == "not ranked: 1 of 2 cells are not finished (1 failed)"
    assert rows[2]["verdict"] == "not ranked: 2 of 2 cells are not finished (1 diverged, 1 pending)"
    stated = Stated(Statement("s", "quick", (), ("toy", "other"), (0, 1, 2)), True)
    rows = leaderboard(results, cells, [stated])
    assert {r["method"]: r["verdict"] for r in rows}["C"] == (
        "not ranked: 1 of 3 cells are not finished (1 not started)"
    )


def test_several_backends_get_a_board_of_all_on_which_they_weigh_alike() -> None:
    results = [result("A", s, 0.4, "x") for s in range(3)] + [result("A", 0, 0.6, "y"), result("B", 0, 0.9, "x")]
    cells = [cell("A", s, "x") for s in range(3)] + [cell("A", 0, "y"), cell("B", 0, "y", "failed")]
    cells += [cell("B", s, "x", "done" if s == 0 else "failed") for s in range(3)]
    rows = leaderboard(results, cells, [])
    assert [(r["backend"], r["method"], r.get("rank"), r.get("success_auc_iqm")) for r in rows] == [
        ("all", "A", 1, 0.5), ("all", "B", None, 0.9), ("x", "A", 1, pytest.approx(0.4)), ("x", "B", None, 0.9),
        ("y", "A", 1, 0.6), ("y", "B", None, None),
    ]  # fmt: skip
    assert rows[1]["verdict"] == "not ranked: 3 of 4 cells are not finished (3 failed)"
    assert [row.get("tolerance") is None for row in rows] == [True, True, False, False, False, True]
