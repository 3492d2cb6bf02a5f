"""The leaderboard: methods ranked by the area under their success curves, and what the seeds allow one to say."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from causalbench.report import stats
from causalbench.report.stats import Array, Comparison
from causalbench.store.cells import StoredCell

Row = dict[str, Any]

FAILED = {"failed", "timeout", "diverged", "skipped", "damaged"}


@dataclass(frozen=True)
class Entry:
    """One method on one board: its finished cells by backend, and how many others did not finish.

    Each grid_point of a suite's grid is an entry of its own.
    """

    method: str
    grid_point: str
    by_backend: dict[str, list[Row]]
    failed: int

    @property
    def name(self) -> str:
        """What a verdict calls it."""
        return f"{self.method} ({self.grid_point})" if self.grid_point else self.method

    @property
    def rows(self) -> list[Row]:
        """All finished cells."""
        return [row for rows in self.by_backend.values() for row in rows]

    @property
    def strata(self) -> list[Array]:
        """The primary metric, one array of seeds per backend."""
        return [np.array([row["success_auc"] for row in rows]) for rows in self.by_backend.values()]

    @property
    def seeds(self) -> int:
        """Seeds finished on every backend of the board."""
        return min(len(rows) for rows in self.by_backend.values())


def leaderboard(results: Sequence[Row], cells: Iterable[StoredCell]) -> list[Row]:
    """Rows of `leaderboard.csv`: a board for each backend and, if there are several of one budget, one named `all`.

    `results` are rows of `results.csv`; `cells` tell which methods there are and what failed. `steps_to_90` is a median
    over cells, None where fewer than half got there within `budget`; `reached_90` and `stopped_cells` count cells.
    `sources` counts the versions of the source code that made the cells of the board: more than one says that it mixes
    code.
    """
    learners = [cell for cell in cells if cell.kind == "learner"]
    backends = sorted({cell.backend for cell in learners})
    boards = [(backend, [backend]) for backend in backends]
    if len(backends) > 1 and len({row["budget"] for row in results}) <= 1:
        boards.insert(0, ("all", backends))
    return [row for name, members in boards for row in _board(name, members, results, learners)]


def _board(name: str, backends: list[str], results: Sequence[Row], cells: Sequence[StoredCell]) -> list[Row]:
    here = [cell for cell in cells if cell.backend in backends]
    finished: dict[tuple[str, str], dict[str, list[Row]]] = {}
    for who in sorted(set(map(_who, here))):
        own = [row for row in results if (row["method"], row["grid_point"]) == who]
        finished[who] = {b: [row for row in own if row["backend"] == b] for b in backends}
    failed = Counter(_who(cell) for cell in here if cell.status.state in FAILED)
    entries = [Entry(*who, by_backend, failed[who]) for who, by_backend in finished.items()]
    ranked = sorted((e for e in entries if e.seeds), key=lambda e: -float(stats.pooled_iqm(e.strata)))
    rows = _ranked_rows(ranked) if ranked else []
    for entry in entries:
        if not entry.seeds:
            missing = ", ".join(backend for backend, found in entry.by_backend.items() if not found)
            verdict = f"not ranked: no finished cell on {missing}"
            named = {"method": entry.method, "grid_point": entry.grid_point}
            rows.append(named | {"seeds": 0, "failed_cells": entry.failed, "verdict": verdict})
    sources = _sources([row for row in results if row["backend"] in backends])
    return [{"backend": name} | row | {"sources": sources} for row in rows]


def _sources(results: Sequence[Row]) -> int:
    """Versions of the code behind `results`: those of the package that has most."""
    versions = Counter(one.partition("=")[0] for one in {one for row in results for one in row["source"].split()})
    return max(versions.values(), default=0)


def _who(cell: StoredCell) -> tuple[str, str]:
    return cell.method, cell.grid_point


def _ranked_rows(ranked: list[Entry]) -> list[Row]:
    seeds = min(entry.seeds for entry in ranked)
    compared = stats.compare_neighbours([entry.strata for entry in ranked]) if seeds >= stats.LEAST_SEEDS else None
    ranks = stats.shared_ranks([c.separated for c in compared] if compared else [False] * (len(ranked) - 1))
    rows = []
    for position, entry in enumerate(ranked):
        following = ranked[position + 1] if position + 1 < len(ranked) else None
        comparison = compared[position] if compared and following else None
        rows.append({"rank": ranks[position]} | _summary(entry) | _against(following, comparison, seeds))
    return rows


def _summary(entry: Entry) -> Row:
    rows, strata = entry.rows, entry.strata
    low, high = stats.bootstrap_interval(stats.pooled_iqm, strata) if entry.seeds >= stats.LEAST_SEEDS else (None, None)
    return {
        "method": entry.method,
        "grid_point": entry.grid_point,
        "seeds": entry.seeds,
        "budget": max(row["budget"] for row in rows),
        "success_auc_iqm": float(stats.pooled_iqm(strata)),
        "success_auc_iqm_low": low,
        "success_auc_iqm_high": high,
        "steps_to_90": _median(row["steps_to_90"] for row in rows),
        "reached_90": sum(row["steps_to_90"] is not None for row in rows),
        "steps_to_90_with_discovery": _median(
            row["steps_to_90"] and row["steps_to_90"] + row["discovery_env_steps"] for row in rows
        ),
        "success_deterministic": _mean(row["success_deterministic"] for row in rows),
        "success_sampled": _mean(row["success_sampled"] for row in rows),
        "best_success": _mean(row["best_success"] for row in rows),
        "held_rate": _mean(row["held_rate"] for row in rows if row["held_rate"] is not None),
        "stopped_cells": sum(row["stopped_at"] is not None for row in rows),
        "reversals_per_1000_steps": _mean(row["reversals_per_1000_steps"] for row in rows),
        "failed_cells": entry.failed,
    }


def _against(following: Entry | None, comparison: Comparison | None, seeds: int) -> Row:
    if seeds == 1:
        return {"verdict": "one seed gives no verdict"}
    if seeds < stats.LEAST_SEEDS:
        return {"verdict": f"{seeds} seeds give no verdict; {stats.LEAST_SEEDS} are needed"}
    if following is None or comparison is None:
        return {"verdict": "nothing is ranked below"}
    verdict = f"better than {following.name}" if comparison.separated else f"not told apart from {following.name}"
    low, high = comparison.bounds
    return {
        "p_better_than_next": comparison.probability,
        "p_better_low": low,
        "p_better_high": high,
        "verdict": verdict,
    }


def _mean(values: Iterable[float]) -> float | None:
    found = list(values)
    return statistics.fmean(found) if found else None


def _median(steps: Iterable[int | None]) -> float | None:
    """Median over seeds, one that never got there counting as infinity; None if that is the median."""
    median = statistics.median(math.inf if step is None else step for step in steps)
    return None if math.isinf(median) else median
