"""The first section: what the suite's hypotheses came to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from causalbench.report.columns import COLUMNS
from causalbench.report.frames import records
from causalbench.report.html.parts import Column, Download, Fold, Note, Row, Section, Table, Value, Verdict
from causalbench.report.html.source import Source
from causalbench.report.html.wording import NOTHING, column, listed, number, text
from causalbench.report.judged import AREA

LEAD = (
    "What was stated before any cell ran is judged here, by exact tests over its planned seeds that keep the chance of "
    "any wrong verdict at 5%. Every other comparison on this page is exploratory."
)


def section(source: Source) -> Section:
    """A sentence per hypothesis, then the numbers behind them."""
    table = source.tables.verdicts
    if table.empty:
        note = Note("No hypotheses stand in this run folder: nothing on this page was singled out before the run.")
        return Section("verdicts", "Verdicts", LEAD, [note])
    areas, stated = table["measure"] == AREA, table["stated"] == 1
    blocks: list[Any] = _hypotheses(table[areas & stated])
    if not blocks:
        blocks = [Note("Nothing was stated before the first cell of this folder ran: all is exploratory.", "warn")]
    later, steps = _hypotheses(table[areas & ~stated]), _hypotheses(table[~areas])
    blocks += [Fold("Exploratory: stated after cells had run", later)] if later else []
    blocks += [Fold("The same by a secondary measure, steps to 90%", steps)] if steps else []
    return Section("verdicts", "Verdicts", LEAD, [*blocks, _numbers(table), *_statements(source)])


def _hypotheses(table: pd.DataFrame) -> list[Any]:
    """A verdict per hypothesis, on all backends together if there are several, and below it those of each."""
    blocks: list[Any] = []
    for _, rows in table.groupby("hypothesis", sort=False):
        first, *each = records(rows)
        blocks.append(_verdict(first))
        if each:
            words = listed(f"{row['backend']} {row['verdict']}" for row in each)
            blocks.append(Fold(f"By backend: {words}", [_verdict(row) for row in each]))
    return blocks


def _verdict(row: dict[str, Any]) -> Verdict:
    return Verdict(row["verdict"], row["sentence"], "" if row["backend"] == "all" else row["backend"])


def _numbers(table: pd.DataFrame) -> Fold:
    names = ("n_a", "n_b", "seeds_missing", "seed_correlation", "paired", "detectable")
    columns = [
        column("hypothesis", numeric=False), column("backend", numeric=False), column("measure", numeric=False),
        column("verdict", numeric=False), Column("difference [95%]", COLUMNS["difference"].sentence, True),
        column("p_value", "p"), column("p_adjusted", "p adjusted"), *(column(name) for name in names),
    ]  # fmt: skip
    rows = [
        Row(
            [
                text(row["hypothesis"]), text(row["backend"]), text(row["measure"].replace("_", " ")),
                text(row["verdict"]), _difference(row), number(row["p_value"], 4), number(row["p_adjusted"], 4),
                *(number(row[name], 2 if name in ("seed_correlation", "detectable") else 0) for name in names),
            ],
            "" if row["backend"] == "all" else row["backend"],
        )
        for row in records(table)
    ]  # fmt: skip
    return Fold(
        "The numbers behind the verdicts", [Table("Verdicts", columns, rows, Download.csv("verdicts.csv", table))]
    )


def _difference(row: dict[str, Any]) -> Value:
    if row["difference"] is None:
        return NOTHING
    digits = 3 if row["measure"] == AREA else 0
    ends = [number(row[end], digits).text for end in ("low", "high")]
    return Value(f"{number(row['difference'], digits).text} [{ends[0]}, {ends[1]}]", row["difference"])


def _statements(source: Source) -> Sequence[Note]:
    """What was planned, and when it was said."""
    return [
        Note(
            f"Stated {'before the first cell' if entry.before_any_cell else 'after cells had run'}, hash "
            f"{entry.statement.hash}: {listed(entry.statement.hypotheses) or 'no hypotheses'}; planned on "
            f"{listed(entry.statement.backends)} with seeds {listed(map(str, entry.statement.seeds))}."
        )
        for entry in source.run.stated()
    ]
