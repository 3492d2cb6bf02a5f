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
from causalbench.report.ranking import can_show, ranks, shown_better
from causalbench.report.stats import Array
from causalbench.report.verdicts import Finished, asked_for
from causalbench.store.cells import StoredCell
from causalbench.store.statements import Stated

Row = dict[str, Any]

FAILED = {"failed", "timeout", "diverged", "skipped", "damaged"}


def at_point(name: str, grid_point: str) -> str:
    """What a method or a backend is called at a point of a suite's grid, "" being that of a suite without one."""
    return f"{name} ({grid_point})" if grid_point else name


@dataclass(frozen=True)
class Entry:
    """One method on one board: its finished cells by backend, and how many of the `planned` ones there are not.

    Each grid_point of a suite's grid is an entry of its own.
    """

    method: str
    grid_point: str
    by_backend: dict[str, list[Row]]
    planned: int
    unfinished: dict[str, int]  # state -> cells

    @property
    def name(self) -> str:
        """What a verdict calls it."""
        return at_point(self.method, self.grid_point)

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

    @property
    def area(self) -> float:
        """What is ranked by, backends weighing alike; backends without a finished cell are left out."""
        return stats.mean_iqm([values for values in self.strata if len(values)])


def leaderboard(results: Sequence[Row], cells: Iterable[StoredCell], stated: Iterable[Stated]) -> list[Row]:
    """Rows of `leaderboard.csv`: a board for each backend and, if there are several of one budget, one named `all`.

    `results` are rows of `results.csv`; `cells` tell which methods there are and what failed, `stated` which seeds
    were planned (those that `--until-decided` saved were not). A method of which a planned cell is not finished is
    not ranked. `steps_to_90` is a median over cells, None where fewer than half got there within `budget`;
    `reached_90` and `stopped_cells` count cells. `sources` counts the versions of the source code that made the
    cells of the board: more than one says that it mixes code.
    """
    learners = [cell for cell in cells if cell.kind == "learner"]
    backends = sorted({cell.backend for cell in learners})
    seeds = {backend: {cell.seed for cell in learners if cell.backend == backend} for backend in backends}
    finished = Finished.of(results, learners)
    for statement in (entry.statement for entry in stated):
        for backend in seeds.keys() & set(statement.backends):
            seeds[backend] |= set(asked_for(statement, finished))
    boards = [(backend, [backend]) for backend in backends]
    if len(backends) > 1 and len({row["budget"] for row in results}) <= 1:
        boards.insert(0, ("all", backends))
    return [row for name, members in boards for row in _board(name, members, results, learners, seeds)]


def _board(
    name: str, backends: list[str], results: Sequence[Row], cells: Sequence[StoredCell], seeds: dict[str, set[int]]
) -> list[Row]:
    here = [cell for cell in cells if cell.backend in backends]
    planned = sum(len(seeds[backend]) for backend in backends)
    entries = []
    for who in sorted(set(map(_who, here))):
        own = [row for row in results if (row["method"], row["grid_point"]) == who]
        by_backend = {b: [row for row in own if row["backend"] == b] for b in backends}
        states: Counter[str] = Counter(
            cell.status.state for cell in here if _who(cell) == who and cell.status.state != "done"
        )
        entries.append(Entry(*who, by_backend, planned, dict(states)))
    whole = sorted((e for e in entries if len(e.rows) == e.planned), key=lambda e: -e.area)
    partial = sorted((e for e in entries if len(e.rows) != e.planned), key=lambda e: -e.area if e.rows else 1.0)
    rows = [*(_ranked_rows(whole) if whole else []), *map(_unranked_row, partial)]
    sources = _sources([row for row in results if row["backend"] in backends])
    return [{"backend": name} | row | {"sources": sources} for row in rows]


def _sources(results: Sequence[Row]) -> int:
    """Versions of the code behind `results`: those of the package that has most."""
    versions = Counter(one.partition("=")[0] for one in {one for row in results for one in row["source"].split()})
    return max(versions.values(), default=0)


def _who(cell: StoredCell) -> tuple[str, str]:
    return cell.method, cell.grid_point


def _ranked_rows(ranked: list[Entry]) -> list[Row]:
    """Best first. Ranks are of the tests on means, and the order within a rank is that of the areas."""
    strata = [entry.strata for entry in ranked]
    shown, enough = shown_better(strata), can_show(strata)
    rows = []
    for position, (entry, (best, worst)) in enumerate(zip(ranked, ranks(shown), strict=True)):
        below = next(iter(ranked[position + 1 :]), None)
        row: Row = {"rank": best, "worst_rank": worst} | _summary(entry)
        if below is None:
            row["verdict"] = "nothing is ranked below"
        elif not enough:
            row["verdict"] = f"{entry.seeds} seed{'s' * (entry.seeds > 1)} cannot tell anything apart"
        else:
            row["p_better_than_next"] = stats.mean_probability_better(entry.strata, below.strata)
            told = "better than" if shown[position, position + 1] else "not told apart from"
            row["verdict"] = f"{told} {below.name}"
        rows.append(row)
    return rows


def _unranked_row(entry: Entry) -> Row:
    """What is finished of a method, which has no rank while a planned cell is not."""
    lacking = entry.planned - len(entry.rows)
    states = {"not started": lacking - sum(entry.unfinished.values())} | entry.unfinished
    told = ", ".join(f"{count} {state}" for state, count in sorted(states.items()) if count > 0)
    verdict = f"not ranked: {lacking} of {entry.planned} cells are not finished ({told})"
    named = {"method": entry.method, "grid_point": entry.grid_point, "seeds": 0, "failed_cells": _failed(entry)}
    return (_summary(entry) if entry.rows else named) | {"verdict": verdict}


def _failed(entry: Entry) -> int:
    return sum(count for state, count in entry.unfinished.items() if state in FAILED)


def _summary(entry: Entry) -> Row:
    rows = entry.rows
    areas = [row["success_auc"] for row in rows]
    return {
        "method": entry.method,
        "grid_point": entry.grid_point,
        "seeds": entry.seeds,
        "budget": max(row["budget"] for row in rows),
        "success_auc_iqm": entry.area,
        "success_auc_lowest": min(areas),
        "success_auc_highest": max(areas),
        "tolerance": stats.tolerance(len(areas)) if len(entry.by_backend) == 1 else None,
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
        "failed_cells": _failed(entry),
    }


def _mean(values: Iterable[float]) -> float | None:
    found = list(values)
    return statistics.fmean(found) if found else None


def _median(steps: Iterable[int | None]) -> float | None:
    """Median over seeds, one that never got there counting as infinity; None if that is the median."""
    median = statistics.median(math.inf if step is None else step for step in steps)
    return None if math.isinf(median) else median
