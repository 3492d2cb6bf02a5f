"""The account of progress reversal: what became of each stage that was reached, from the traces in `episodes.csv`.

Every function takes rows of the run's `episodes.csv` and looks at the deterministic episodes. Progress is exact: the
share of the stages that are behind, (U(s) - 1) / n_stages, and 1 on success.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causalbench.report.columns import KEYS, TABLES
from causalbench.store.episodes import stage_trace

Row = dict[str, Any]
STAGE_COUNTS = TABLES["stage_account.csv"][len(KEYS) + 2 :]
MEASURES = ("largest_progress", "final_progress", "regression_loss", "path_efficiency", "largest_drawdown")


class Played(NamedTuple):
    """One episode: `path` (n + 1,) has the stage before each step and after the last, n_stages + 1 on success."""

    path: NDArray[np.int64]
    n_stages: int
    kept: bool  # success that stood what the task puts it to, where it puts it to anything

    @property
    def progress(self) -> NDArray[np.float64]:
        """Progress along the path, in [0, 1]."""
        return (self.path - 1) / self.n_stages

    @property
    def success(self) -> bool:
        """The task's verdict."""
        return bool(self.path[-1] > self.n_stages)


def stage_account(episodes: pd.DataFrame) -> list[Row]:
    """Rows of `stage_account.csv`: per cell and stage, how many episodes reached it, and what became of it.

    A stage is reached with U(s) at or above it. It is held if the episode never falls below it again; else it fell
    back, and was recovered if the episode ends at or above it, lost for good otherwise. Stage n_stages + 1 is success,
    held if it stood the task's own test.
    """
    return _per_cell(episodes, lambda played: (_stage_row(played, s) for s in range(1, played[0].n_stages + 2)))


def _stage_row(played: Sequence[Played], stage: int) -> Row:
    fates = [_fate(episode, stage) for episode in played]
    counts = np.sum(fates, axis=0)
    return {"stage": stage, "episodes": len(played)} | dict(zip(STAGE_COUNTS, map(int, counts), strict=True))


def _fate(episode: Played, stage: int) -> tuple[int, ...]:
    """Reached, held, fell back, recovered, lost (each 0 or 1), falls, steps in the stage and below it afterwards."""
    path = episode.path
    there = path >= stage
    if not there.any():
        return 8 * (0,)
    since = there[int(there.argmax()) :]
    falls, below = int((since[:-1] & ~since[1:]).sum()), int((~since[:-1]).sum())
    fell, at_end = falls > 0, bool(since[-1])
    if stage > episode.n_stages and not episode.kept:
        fell, at_end, falls = True, False, 1
    return (
        1,
        int(not fell),
        int(fell),
        int(fell and at_end),
        int(not at_end),
        falls,
        int((path[:-1] == stage).sum()),
        below,
    )


def moves(episodes: pd.DataFrame) -> list[Row]:
    """Rows of `moves.csv`: per cell, how many steps led from one stage to another; success is stage n_stages + 1."""
    return _per_cell(episodes, _moves)


def _moves(played: Sequence[Played]) -> Iterator[Row]:
    steps = np.concatenate([np.stack([e.path[:-1], e.path[1:]], axis=1) for e in played])
    for (before, after), count in zip(*np.unique(steps, axis=0, return_counts=True), strict=True):
        yield {"from_stage": int(before), "to_stage": int(after), "count": int(count)}


def progress_account(episodes: pd.DataFrame) -> list[Row]:
    """Rows of `progress_account.csv`: means over the episodes of each cell, see `measures`."""
    return _per_cell(episodes, lambda played: iter([_progress_row(played)]))


def _progress_row(played: Sequence[Played]) -> Row:
    table = pd.DataFrame([measures(episode.progress) for episode in played])
    fell = table[table["largest_drawdown"] > 0]
    means = {name: float(table[name].mean()) for name in MEASURES}
    return (
        {"episodes": len(played)}
        | means
        | {
            "episodes_with_drawdown": len(fell),
            "drawdown_recovered": float(fell["drawdown_recovered"].mean()) if len(fell) else None,
        }
    )


def measures(progress: NDArray[np.float64]) -> dict[str, float]:
    """What a curve of progress says, after PRM-as-a-Judge; `progress` (n + 1,) starts before the first step.

    - `regression_loss`: mean over steps of how far progress is below its peak so far, as a share of the largest one;
    - `path_efficiency`: the square of the largest progress divided by the way travelled up and down;
    - `largest_drawdown`: the deepest fall below the peak so far, and `drawdown_recovered` the share of the first such
      fall that was won back at best; NaN where progress never fell.
    """
    largest, peak = float(progress.max()), np.maximum.accumulate(progress)
    below, way = peak - progress, float(np.abs(np.diff(progress)).sum())
    deepest = int(below.argmax())
    drawdown = float(below[deepest])
    won_back = float(progress[deepest:].max() - progress[deepest])
    return {
        "largest_progress": largest,
        "final_progress": float(progress[-1]),
        "regression_loss": float(below[1:].mean()) / largest if largest else 0.0,
        "path_efficiency": largest**2 / way if way else 0.0,
        "largest_drawdown": drawdown,
        "drawdown_recovered": min(1.0, won_back / drawdown) if drawdown else float("nan"),
    }


def latching(episodes: pd.DataFrame) -> list[Row]:
    """Rows of `latching.csv`: what rules that remember would add, in points of a hundred, on the same episodes.

    `latched` is the share by the rule, `at_end` the share of the same bar at the end of the episode:
    - `peak_progress`: progress once reached `threshold`, whatever became of it;
    - `recorded_milestones`: stages that were ever completed, as a share of all; no threshold;
    - `success_once`: a success counts, whether or not it stands the task's own test.
    """
    return _per_cell(episodes, _latching)


def _latching(played: Sequence[Played]) -> Iterator[Row]:
    largest, final = (np.array([pick(e.path) - 1 for e in played]) for pick in (np.max, lambda path: path[-1]))
    n = played[0].n_stages
    for k in range(1, n):
        yield _rule("peak_progress", k / n, float((largest >= k).mean()), float((final >= k).mean()))
    yield _rule("recorded_milestones", None, float(largest.mean() / n), float(final.mean() / n))
    kept = float(np.mean([episode.kept for episode in played]))
    yield _rule("success_once", None, float(np.mean([episode.success for episode in played])), kept)


def _rule(rule: str, threshold: float | None, latched: float, at_end: float) -> Row:
    points = 100 * (latched - at_end)
    return {"rule": rule, "threshold": threshold, "latched": latched, "at_end": at_end, "points": points}


def _per_cell(episodes: pd.DataFrame, account: Callable[[list[Played]], Iterator[Row]]) -> list[Row]:
    certain = episodes[episodes["deterministic"] == 1]
    return [
        dict(zip(KEYS, keys, strict=True)) | row
        for keys, rows in certain.groupby(list(KEYS), sort=False, dropna=False)
        for row in account([_played(row) for row in rows.to_dict("records")])
    ]


def _played(row: Mapping[Hashable, Any]) -> Played:
    path = np.array([*stage_trace(row["stages"]), row["final_stage"]])
    # `held` is empty where a task puts a success to no test.
    return Played(path, int(row["n_stages"]), bool(row["success"]) and row["held"] != 0)
