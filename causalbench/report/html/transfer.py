"""The section on transfer: policies on backends that they were not trained on, and graphs of other backends."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from causalbench.report.html import flow
from causalbench.report.html.parts import Column, Download, Note, Row, Section, Table, Value
from causalbench.report.html.source import Source
from causalbench.report.html.wording import NOTHING, entry, number, text

LEAD = (
    "Final success of the deterministic policies, means over seeds with the least and the most. What a policy was "
    "trained on stands in the row, what it was played on in the column; on its own backend it is the final evaluation."
)
MEASURE = "success_deterministic"


def section(source: Source) -> Section:
    """A table of every method, or how to get one."""
    return Section("transfer", "Policies on other backends", LEAD, [_table(source)])


def _table(source: Source) -> Note | Table:
    moved = source.tables.transfer
    if moved.empty:
        return Note(f"Not played yet: causalbench transfer {source.run.path.name}")
    own = source.tables.results.assign(played_on=source.tables.results["backend"])
    names = [*flow.GROUP, "played_on", "seed", MEASURE]
    found = pd.concat([own[names], moved[names]])
    places = sorted(set(found["played_on"]))
    rows = [
        Row(
            [
                text(entry(keys)), text(keys["backend"]), number(here["seed"].nunique(), 0),
                *(_value(here.loc[here["played_on"] == place, MEASURE]) for place in places),
            ],
            keys["backend"], keys["method"],
        )
        for keys, here in _by_method(found)
    ]  # fmt: skip
    columns = [Column("method"), Column("trained on"), Column("seeds", "", True)]
    columns += [Column(place, f"Played on {place}.", True) for place in places]
    return Table("Success where it was played", columns, rows, Download.csv("transfer.csv", moved))


def _by_method(found: pd.DataFrame) -> Iterator[tuple[dict[str, str], pd.DataFrame]]:
    for keys, here in found.groupby(flow.GROUP):
        yield dict(zip(flow.GROUP, map(str, keys), strict=True)), here


def _value(shares: pd.Series[float]) -> Value:
    if shares.empty:
        return NOTHING
    mean = float(shares.mean())
    return Value(f"{mean:.2f} ({shares.min():.2f} to {shares.max():.2f})", mean)
