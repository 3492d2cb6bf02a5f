"""The section on what went wrong or is missing: it is never left out."""

from __future__ import annotations

from collections import Counter
from typing import Any

from causalbench.report.decomposition_warnings import decomposition_warnings
from causalbench.report.html.parts import Column, Fold, Note, Row, Section, Table, Text, Value
from causalbench.report.html.source import Source
from causalbench.report.html.wording import count, listed, text

LOG_LINES = 15
LOGS = 12
"""Logs that the page carries; all of them are in the run folder."""


def section(source: Source) -> Section:
    """Cells that are not done, damage, what speaks against the decomposition, and the known gaps of backends."""
    unfinished = [cell for cell in source.cells if cell.status.state != "done"]
    states = Counter(cell.status.state for cell in source.cells)
    summary = listed(f"{n} {state}" for state, n in sorted(states.items()))
    blocks: list[Any] = [Note(f"{count(len(source.cells), 'cell')}: {summary}.", "warn" if unfinished else "good")]
    blocks += [Note(f"Not counted: {sentence}", "warn") for sentence in source.problems]
    if unfinished:
        rows = [
            Row(
                [Value(cell.status.state, cell.status.state, mark="warn"), text(cell.id), text(cell.status.reason)],
                cell.backend, cell.method,
            )
            for cell in unfinished
        ]  # fmt: skip
        columns = [Column("state"), Column("cell"), Column("reason")]
        blocks += [Table("Cells that are not done", columns, rows), *_logs(source)]
    tables = source.tables
    warned = decomposition_warnings(tables.discovery, tables.stage_account, tables.episodes)
    blocks += [Note(f"A warning of the decomposition: {sentence}", "warn") for sentence in warned]
    blocks.append(_gaps(source))
    return Section("failures", "Failures, skipped cells and known gaps", "", blocks)


def _logs(source: Source) -> list[Fold]:
    ended = [cell for cell in source.cells if cell.status.state in ("failed", "diverged", "timeout")]
    found = [Text(cell.id, tail) for cell in ended[:LOGS] if (tail := cell.log_tail(LOG_LINES))]
    return [Fold(f"The ends of {count(len(found), 'log')}", found)] if found else []


def _gaps(source: Source) -> Any:
    rows = [
        Row([text(backend), text(number), text(reason)], backend)
        for backend, gaps in source.known_gaps.items()
        for number, reason in gaps.items()
    ]
    if not rows:
        return Note("The backends of this run declare no known gap in the contract.")
    return Table("Known gaps of backends", [Column("backend"), Column("line of the contract"), Column("reason")], rows)
