"""The CSV files of a run folder. No times, and rows in an order of their own: a rerun gives the same bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from causalbench.core.discovery.edges import edge_rows, evidence_columns
from causalbench.core.learners.records import Evaluation
from causalbench.errors import RunFolderError
from causalbench.report.agreement import agreement
from causalbench.report.columns import KEYS, TABLES
from causalbench.report.leaderboard import leaderboard
from causalbench.report.sequential import look_rows
from causalbench.report.stage_account import latching, moves, progress_account, stage_account
from causalbench.report.stats import area_under, wilson
from causalbench.report.verdicts import verdict_rows
from causalbench.store.beside import BESIDE
from causalbench.store.cells import StoredCell
from causalbench.store.comparable import merged
from causalbench.store.episodes import episode_row, return_columns
from causalbench.store.records import Counts, write_rows
from causalbench.store.run_folder import RunFolder
from causalbench.store.statements import Stated, merged_statements

Row = dict[str, Any]
Table = tuple[Sequence[str], list[Row]]


def write_tables(run: RunFolder) -> dict[str, Table]:
    """Write every table of `run` from its cells; what was written, by file."""
    found = tables(run.cells(), run.stated())
    write_found(run, found)
    return found


def write_found(run: RunFolder, found: Mapping[str, Table]) -> None:
    """Write the tables `found`, by file, into `run`."""
    for file, (columns, rows) in found.items():
        write_rows(run.path / file, columns, rows)


def tables(cells: Sequence[StoredCell], stated: Sequence[Stated]) -> dict[str, Table]:
    """File -> names of its columns and its rows: all that the cells of a run say, and what it set out to show."""
    learned = [cell for cell in cells if cell.is_done("learner")]
    examined = {cell.id: cell.evaluations() for cell in learned}
    results = [_result_row(cell, examined[cell.id], cell.counts()) for cell in learned]
    board = leaderboard(results, cells, stated)
    episodes = episode_table(learned)
    rows = {
        "results.csv": results,
        "curves.csv": [row for cell in learned for row in _curve_rows(cell, examined[cell.id])],
        "returns.csv": [row for cell in learned for row in _return_rows(cell, examined[cell.id])],
        "stages.csv": [row for cell in learned for row in _stage_rows(cell)],
        **_account(*episodes),
        **{file: [_keys(cell) | row for cell in learned for row in cell.beside(file)] for file in BESIDE},
        "leaderboard.csv": board,
        "agreement.csv": agreement(board),
        "verdicts.csv": verdict_rows(results, cells, stated),
        "looks.csv": look_rows(results, cells, stated),
        "timing.csv": [_timing_row(cell) for cell in cells],
    }
    edges = _discovery_table([cell for cell in cells if cell.is_done("discovery")])
    written = {file: (TABLES[file], found) for file, found in rows.items()}
    return written | {"episodes.csv": episodes, "discovery.csv": edges}


def _account(columns: Sequence[str], rows: Sequence[Row]) -> dict[str, list[Row]]:
    """What follows from the episodes."""
    episodes = pd.DataFrame([*rows], columns=list(columns))
    makers = (stage_account, moves, progress_account, latching)
    return {f"{make.__name__}.csv": make(episodes) for make in makers}


def episode_table(learned: Sequence[StoredCell]) -> Table:
    """`episodes.csv` of a run: the final evaluations of all finished learner cells."""
    found = [(cell, cell.episodes()) for cell in learned]
    further = return_columns([episode for _, episodes in found for episode in episodes])
    rows = [_keys(cell) | episode_row(episode) for cell, episodes in found for episode in episodes]
    return (*TABLES["episodes.csv"], *further), rows


def merged_boards(runs: Sequence[RunFolder]) -> tuple[list[Row], list[Row]]:
    """The verdicts and the leaderboard of all `runs` together; a cell that stands in several counts once.

    Raises `RunFolderError` for a folder without cells and as `merged` does.
    """
    found = {run.path: run.cells() for run in runs}
    for path, cells in found.items():
        if not cells:
            raise RunFolderError(f"{path}: no cells here; give the folder that `causalbench run` wrote")
    ordered = merged(cell for cells in found.values() for cell in cells)
    results, stated = result_rows(ordered), merged_statements(run.stated() for run in runs)
    return verdict_rows(results, ordered, stated), leaderboard(results, ordered, stated)


def result_rows(cells: Sequence[StoredCell]) -> list[Row]:
    """Rows of `results.csv`, one per finished learner cell.

    `success_auc` is the area under the success curve up to `budget`, in env steps. `steps_to_90` is None for a cell
    that never got there, and `stopped_at` for one that was not stopped before; a stopped cell's curve goes on at its
    last value. `episodes` and the other columns about success are of the final evaluation, but `best_success`, which
    is of the best one; `reversals_per_1000_steps` is of training.
    """
    return [_result_row(cell, cell.evaluations(), cell.counts()) for cell in cells if cell.is_done("learner")]


def _result_row(cell: StoredCell, evaluations: list[Evaluation], counts: Counts) -> Row:
    final = evaluations[-1]
    low, high = wilson(round(final.success_deterministic * final.episodes), final.episodes)
    budget = cell.identity["env_steps"]
    # Worlds that step together may pass the budget by a few steps.
    steps, success = [min(e.env_steps, budget) for e in evaluations], [e.success_deterministic for e in evaluations]
    return _keys(cell) | {
        "budget": budget,
        "env_steps": counts.env_steps,
        "discovery_env_steps": counts.discovery_env_steps,
        "episodes": final.episodes,
        "success_deterministic": final.success_deterministic,
        "success_sampled": final.success_sampled,
        "success_low": low,
        "success_high": high,
        "held_rate": final.held_rate,
        "best_success": max(success),
        "success_auc": area_under([*steps, budget], [*success, success[-1]], budget),
        "steps_to_90": next((e.env_steps for e in evaluations if e.success_deterministic >= 0.9), None),
        "stopped_at": counts.env_steps if counts.env_steps < budget else None,
        "mean_final_stage": final.mean_final_stage,
        "reversals_per_episode": final.reversals_per_episode,
        "reversals_per_1000_steps": 1000 * counts.reversals / counts.env_steps,
        "mean_return": sum(final.term_returns.values()),
        "graph": counts.graph,
        "source": cell.status.source,
    }


def _keys(cell: StoredCell) -> Row:
    return {key: getattr(cell, key) for key in KEYS}


def _curve_rows(cell: StoredCell, evaluations: Sequence[Evaluation]) -> Iterator[Row]:
    for evaluation in evaluations:
        yield _keys(cell) | {
            "env_steps": evaluation.env_steps,
            "success_deterministic": evaluation.success_deterministic,
            "success_sampled": evaluation.success_sampled,
            "reversals_per_episode": evaluation.reversals_per_episode,
            "mean_final_stage": evaluation.mean_final_stage,
        }


def _return_rows(cell: StoredCell, evaluations: Sequence[Evaluation]) -> Iterator[Row]:
    for evaluation in evaluations:
        for term, value in evaluation.term_returns.items():
            yield _keys(cell) | {"env_steps": evaluation.env_steps, "term": term, "mean_term_return": value}


def _stage_rows(cell: StoredCell) -> Iterator[Row]:
    """Training episodes that reached a stage, steps from stage to stage, and updates of each stage's agent."""
    counts = cell.counts()
    rows: list[tuple[str, int | None, int | str, int]] = [("reached", None, s, n) for s, n in counts.reached.items()]
    rows += [("transitions", i, j, n) for i, j, n in counts.transitions]
    rows += [("updates", None, s, n) for s, n in counts.updates.items()]
    for row in rows:
        yield dict(zip(TABLES["stages.csv"], (*_keys(cell).values(), *row), strict=True))


def _discovery_table(cells: Sequence[StoredCell]) -> Table:
    """One row per edge of every discovery, with the evidence of all discoverers."""
    evidence, rows = dict[str, None](), list[Row]()
    for cell in cells:
        graph, effects = cell.graph(), cell.effects()
        evidence |= dict.fromkeys(evidence_columns(graph))
        keys = {key: getattr(cell, key) for key in ("task", "backend", "discoverer", "grid_point", "seed")}
        for row in edge_rows(graph):
            effect = effects.get((row["stage"], row["term"], row["action"]), {})
            rows.append(keys | row | effect)
    return (*TABLES["discovery.csv"], *evidence), rows


def _timing_row(cell: StoredCell) -> Row:
    status = cell.status
    speed = status.env_steps / status.seconds if status.seconds and status.env_steps else None
    row = (cell.id, status.state, status.seconds, status.env_steps, speed)
    return dict(zip(TABLES["timing.csv"], row, strict=True))
