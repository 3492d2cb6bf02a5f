"""The section on where the numbers come from: command, machine, versions, code, and every table as a file."""

from __future__ import annotations

import json
import shlex
from typing import Any

from causalbench.report.columns import COLUMNS
from causalbench.report.html.parts import Column, Download, Downloads, Fold, Note, Row, Section, Table, Text
from causalbench.report.html.source import Source
from causalbench.report.html.wording import listed, number, text

MOST_BYTES = 2_000_000
"""A larger table is not carried by the page: it lies in the run folder."""


def section(source: Source) -> Section:
    """Sessions, code, graphs, the suite, and the tables."""
    blocks: list[Any] = [_session(session, i) for i, session in enumerate(source.sessions, start=1)]
    if not blocks:
        blocks = [Note("environment.json says of no session what it ran on.", "warn")]
    blocks += [_code(source), _tables(source), _suite(source)]
    lead = "What is needed to judge and to repeat the numbers. `causalbench verify RUN` runs some cells again."
    return Section("provenance", "Where the numbers come from", lead, blocks)


def _session(session: Any, index: int) -> Table:
    said = {
        key: session.get(key)
        for key in ("started", "command", "python", "platform", "cpu", "cores", "packages", "plugins", "git")
    }
    rows = [Row([text(key), text(_plain(value))]) for key, value in said.items()]
    return Table(f"Session {index}", [Column("what"), Column("value")], rows)


def _plain(value: Any) -> str:
    """JSON of a stranger's as one line."""
    if isinstance(value, list):
        return shlex.join(map(str, value))
    if isinstance(value, dict):
        return listed(f"{key} {one if isinstance(one, str) else json.dumps(one)}" for key, one in value.items())
    return "unknown" if value is None else str(value)


def _code(source: Source) -> Table:
    results, rows = source.tables.results, []
    for (backend, source_hash), here in results.groupby(["backend", "source"]):
        graphs = sorted(set(here["graph"].dropna()))
        rows.append(Row([text(backend), number(len(here), 0), text(source_hash), text(listed(graphs))], str(backend)))
    columns = [
        Column("backend"), Column("trained agents", "", True), Column("code", COLUMNS["source"].sentence),
        Column("causal graphs", COLUMNS["graph"].sentence),
    ]  # fmt: skip
    return Table("Code behind the results", columns, rows)


def _tables(source: Source) -> Downloads:
    links = {name: Download.csv(f"{name}.csv", frame) for name, frame in vars(source.tables).items()}
    fitting = [link for link in links.values() if len(link.href) <= MOST_BYTES]
    left = [link.name for link in links.values() if len(link.href) > MOST_BYTES]
    title = "Every table of the run as CSV" + (
        f" (too large for the page, in the run folder: {listed(left)})" if left else ""
    )
    return Downloads(title, fitting)


def _suite(source: Source) -> Fold:
    return Fold("The suite that was run", [Text("suite.yaml", source.run.suite_text())])
