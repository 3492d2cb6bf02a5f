"""The section on progress reversal: stages held and lost, measures of progress, and what remembering would add."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from causalbench.report.columns import COLUMNS
from causalbench.report.frames import records
from causalbench.report.html import flow, transitions
from causalbench.report.html.parts import Column, Download, Fold, Note, Row, Section, Table, Value
from causalbench.report.html.source import Source
from causalbench.report.html.wording import column, entry, number, percent, text
from causalbench.report.reversal_shares import vanished_share

NAMED = [Column("backend"), Column("method")]
LEAD = (
    "Deterministic episodes of each policy's final evaluation. A stage is reached when the episode is in it or beyond "
    "it; it is held if the episode never falls below it again. Benchmarks that remember a stage once it was reached "
    "cannot see the rest. A success is held if it stood the task's own test, such as lift and "
    "hold. Episodes of all seeds are pooled; the range beside a share is that of single seeds."
)

VANISHED = ("vanished_without_redundant", "vanished_without_causes")
CAUSES = (
    "Every step that fell back was taken again from a snapshot, with the actions that cause none of the stage's "
    "rewards at 0, and with its causes at 0. A reversal that then does not come was the doing of these actions, alone "
    "or with the others. A policy built on the same graph sets no redundant action, so that none of its reversals can "
    "vanish without them. Intervals are over episodes of these policies, not over seeds."
)


def section(source: Source) -> Section:
    """Stage flow and the account of reversal."""
    if source.tables.stage_account.empty:
        note = Note("No finished policy kept its episodes.")
        return Section("stages", "What became of each stage", "", [note])
    blocks = [
        *(found.block() for found in flow.multiples(source)),
        Fold("Every stage in numbers", [_fates(source)]), *_causes(source), _progress(source), _latching(source),
        *(found.block() for found in transitions.multiples(source)),
        Fold("Steps from stage to stage", [_moves(source)]),
    ]  # fmt: skip
    return Section("stages", "What became of each stage", LEAD, blocks)


def _row(row: dict[str, Any], *values: Value) -> Row:
    return Row([text(row["backend"]), text(entry(row)), *values], row["backend"], row["method"])


def _fates(source: Source) -> Table:
    table = flow.pooled(source.tables.stage_account)
    last = dict(table.groupby(flow.GROUP)["stage"].max())
    names = ("reached", "held", "fell_back", "recovered", "lost")
    columns = [
        *NAMED, Column("stage", "The stage; success comes after the last one.", True),
        *(column(f"episodes_{name}", name.replace("_", " ")) for name in names),
        Column("held by single seeds", "Least and most of the seeds.", True), column("falls"),
    ]  # fmt: skip
    rows = []
    for row in records(table):
        is_success = row["stage"] == last[tuple(row[key] for key in flow.GROUP)]
        stage = Value("success" if is_success else str(row["stage"]), float(row["stage"]))
        shares = [percent(row[f"episodes_{name}"] / row["episodes"]) for name in names]
        seeds = Value(f"{100 * row['held_least']:.0f} to {100 * row['held_most']:.0f}%", row["held_least"])
        rows.append(_row(row, stage, *shares, seeds, number(row["falls"], 0)))
    return Table(
        "Stages, as shares of episodes", columns, rows, Download.csv("stage_account.csv", source.tables.stage_account)
    )


def _causes(source: Source) -> list[Note | Table]:
    """Whose doing the reversals are, where somebody asked."""
    rows = source.tables.reversals
    if rows.empty:
        return [Note(f"Whose doing the reversals are is not known yet: causalbench reversals {source.run.path.name}")]
    columns = [
        *NAMED, Column("actions", "Whether the policy's mean action was taken, or actions were drawn."),
        column("episodes"), column("reversals"),
        *(column(name, name.replace("_", " ")) for name in ("reversals_repeated", *VANISHED)),
    ]  # fmt: skip
    groups = rows.groupby([*flow.GROUP, "deterministic"])
    found = [_whose(dict(zip([*flow.GROUP, "deterministic"], keys, strict=True)), own) for keys, own in groups]
    csv = Download.csv("reversals.csv", rows)
    return [
        Note(CAUSES),
        Table("Reversals that vanish when the step is taken again without some actions", columns, found, csv),
    ]


def _whose(keys: dict[str, Any], rows: pd.DataFrame) -> Row:
    reversals, repeated = int(rows["reversals"].sum()), int(rows["reversals_repeated"].sum())
    episodes = rows[["seed", "episode"]].drop_duplicates()
    actions = text("mean" if keys["deterministic"] else "drawn")
    counts = (number(len(episodes), 0), number(reversals, 0), number(repeated, 0))
    return _row(keys, actions, *counts, *(_share(rows, name) for name in VANISHED))


def _share(rows: pd.DataFrame, vanished: str) -> Value:
    share, low, high = vanished_share(rows, vanished)
    if np.isnan(share):
        return percent(None)
    interval = "" if np.isnan(low) else f" ({100 * low:.0f} to {100 * high:.0f}%)"
    return Value(f"{100 * share:.0f}%{interval}", share)


def _progress(source: Source) -> Table:
    names = [
        "largest_progress",
        "final_progress",
        "regression_loss",
        "path_efficiency",
        "largest_drawdown",
        "drawdown_recovered",
    ]
    means = _over_seeds(source.tables.progress_account, flow.GROUP, names)
    rows = [_row(row, number(row["seeds"], 0), *(number(row[name]) for name in names)) for row in records(means)]
    columns = [*NAMED, Column("seeds", "", True), *(column(name) for name in names)]
    return Table(
        "Progress, means over seeds",
        columns,
        rows,
        Download.csv("progress_account.csv", source.tables.progress_account),
    )


def _latching(source: Source) -> Table:
    """Points of success that each rule would add: a column per rule."""
    found = _over_seeds(source.tables.latching, [*flow.GROUP, "rule", "threshold"], ["points"])
    found["asked"] = [_rule(row) for row in records(found)]
    rules = list(dict.fromkeys(found.sort_values(["rule", "threshold"])["asked"]))
    table = found.pivot(index=flow.GROUP, columns="asked", values="points").reset_index()
    columns = [*NAMED, *(Column(rule, COLUMNS["rule"].sentence, True) for rule in rules)]
    rows = [_row(row, *(number(row[rule], 1) for rule in rules)) for row in records(table)]
    csv = Download.csv("latching.csv", source.tables.latching)
    return Table("Points of a hundred that a rule which remembers would add to the same episodes", columns, rows, csv)


def _rule(row: dict[str, Any]) -> str:
    words = str(row["rule"]).replace("_", " ")
    return words if row["threshold"] is None else f"{words} ≥ {row['threshold']:.2f}"


def _moves(source: Source) -> Table:
    columns = [
        *NAMED, column("from_stage"), column("to_stage"), column("count", "steps"), Column("per 1,000 steps", "", True),
    ]  # fmt: skip
    rows = [
        _row(row, *(number(row[name], 0) for name in ("from_stage", "to_stage", "count")), number(row["rate"], 1))
        for row in records(transitions.rates(source.tables.moves))
    ]
    return Table("Steps that led to another stage", columns, rows, Download.csv("moves.csv", source.tables.moves))


def _over_seeds(table: pd.DataFrame, by: list[str], names: list[str]) -> pd.DataFrame:
    groups = table.groupby(by, dropna=False)
    return groups[names].mean().assign(seeds=groups["seed"].nunique()).reset_index()
