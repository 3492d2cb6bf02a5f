"""The section on controls: what spoilt and perfect causes are worth, and what discovery finds where nothing is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from causalbench.report.frames import records
from causalbench.report.html.parts import Column, Note, Row, Section, Table, Value
from causalbench.report.html.source import Source
from causalbench.report.html.wording import column, entry, number, percent, text
from causalbench.report.stats import wilson

LEAD = (
    "A benefit that stays when the causes are spoilt is no benefit of causes. Controls of learning change the causal "
    "matrix in one thing; controls of discovery count what it selected where the oracle finds nothing."
)
WORDS = {
    "shuffled": "rows of the causal actions dealt out anew",
    "redrawn": "as many edges, elsewhere",
    "plus1": "one further action",
    "plus2": "two further actions",
    "other": "as many other actions",
    "none": "no causes",
    "manual": "a human's",
    "discovered": "discovered",
    "oracle": "the oracle's",
}
"""A control of a method, or where its causes come from -> words."""


def section(source: Source) -> Section:
    """Controls of learning and of discovery; what there is none of is said."""
    blocks = [*_methods(source), *_false_edges(source)]
    return Section("controls", "Controls", LEAD, blocks)


def _methods(source: Source) -> list[Any]:
    methods = {cell.method: cell.identity["method"] for cell in source.cells if cell.method}
    if not any(_is_control(method) for method in methods.values()):
        return [Note("This run has no controls of learning, such as cmSAC-shuffled: suites/ablation.yaml has them.")]
    kinds = {name: _kind(method) for name, method in methods.items()}
    board = source.tables.leaderboard
    rows = [
        Row(
            [
                text(row["backend"]), text(entry(row)), text(kinds[row["method"]]),
                number(row["seeds"], 0), number(row["success_auc_iqm"]), percent(row["success_deterministic"]),
            ],
            "" if row["backend"] == "all" else row["backend"], row["method"],
        )
        for row in records(board) if row["budget"] is not None
    ]  # fmt: skip
    columns = [
        Column("backend"), Column("method"), Column("its causes"), column("seeds"),
        column("success_auc_iqm", "success AUC (IQM)"), column("success_deterministic", "final success"),
    ]  # fmt: skip
    return [Table("Spoilt and perfect causes", columns, rows)]


def _is_control(method: Mapping[str, Any]) -> bool:
    return method.get("control", "none") != "none" or method.get("matrix") == "oracle"


def _kind(method: Mapping[str, Any]) -> str:
    control, matrix = (str(method.get(key, "none")) for key in ("control", "matrix"))
    word = matrix if control == "none" else control
    return WORDS.get(word, word)


def _false_edges(source: Source) -> list[Any]:
    table = source.tables.discovery
    absent = table[table["oracle_grade"] == "absent"]
    if absent.empty:
        return [
            Note("No oracle was asked in this run, so false discoveries cannot be counted (discovery: oracle_states).")
        ]
    rows = []
    for (backend, discoverer), here in absent.groupby(["backend", "discoverer"]):
        false, n = int(here["selected"].sum()), len(here)
        low, high = wilson(false, n)
        share = Value(f"{100 * false / n:.1f}% [{100 * low:.1f}, {100 * high:.1f}]", false / n, (low, false / n, high))
        rows.append(Row([text(backend), text(discoverer), number(n, 0), number(false, 0), share], str(backend)))
    columns = [
        Column("backend"), column("discoverer", numeric=False),
        Column("absent edges", "Edges of all discoveries that the oracle grades absent.", True),
        Column("selected all the same", "", True),
        Column("share", "With its 95% Wilson interval, as if edges were independent.", True),
    ]  # fmt: skip
    return [Table("False discoveries", columns, rows)]
