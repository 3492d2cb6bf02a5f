"""Looks at a run that adds seeds until what it states is decided, and when it stops: `looks.csv`.

The 5% are shared out among the looks, which are fixed before the first cell starts; at each, Holm's step-down tests
what is still open, and what it decides stays decided. So the chance of any wrong verdict is at most 5% over all looks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from causalbench.report.judged import AREA, Judged
from causalbench.report.permutation import least_p
from causalbench.report.stats import ALPHA
from causalbench.report.verdicts import Finished, begun, boards, decide
from causalbench.store.cells import StoredCell
from causalbench.store.statements import Stated
from causalbench.suite.hypotheses import Statement

Row = dict[str, Any]

MOST_LOOKS = 4


def with_looks(statement: Statement) -> Statement:
    """`statement` of a run that looks at most four times, first where so many seeds can decide anything."""
    seeds, places = len(statement.seeds), boards(statement)
    level = ALPHA / MOST_LOOKS / (len(statement.hypotheses) * len(places))
    strata = len(next(iter(places.values())))
    first = next((n for n in range(2, seeds) if least_p([(n, n, False)] * strata) <= level), seeds)
    looks = {round(first + (seeds - first) * k / (MOST_LOOKS - 1)) for k in range(MOST_LOOKS)}
    return replace(statement, looks=tuple(sorted(looks)))


def look_rows(results: Iterable[Row], cells: Iterable[StoredCell], stated: Iterable[Stated]) -> list[Row]:
    """Rows of `looks.csv`: each look of what was stated with looks, up to the last that was begun."""
    finished = Finished.of(results, cells)
    return [row for entry in stated if entry.statement.looks for row in _rows(entry, finished)]


def _rows(entry: Stated, finished: Finished) -> list[Row]:
    statement = entry.statement
    numbers = [n for n in range(1, len(statement.looks) + 1) if begun(statement, finished, n)]
    return [_row(statement, n, decide(entry, finished, n)) for n in numbers]


def _row(statement: Statement, number: int, judged: Sequence[Judged]) -> Row:
    """Where there are several backends a hypothesis is decided when it is on all of them together."""
    first = next(iter(boards(statement)))
    main = [one for one in judged if one.measure == AREA and one.backend == first]
    undecided = [one for one in main if not one.decided]
    spent, total = statement.looks[number - 1], len(statement.seeds)
    stops = True
    if not undecided:
        reason = f"stops: every hypothesis is decided, {total - spent} of {total} seeds are saved"
    elif spent == total:
        reason = f"stops: the {total} seeds are used up"
    elif all(one.obstacle for one in undecided):
        reason = f"stops: what is not decided lacks cells, so {undecided[0].obstacle}"
    else:
        stops, reason = False, f"goes on: {len(undecided)} of {len(main)} hypotheses are not decided"
    return {
        "look": number, "spent": spent, "decided": len(main) - len(undecided), "undecided": len(undecided),
        "stops": int(stops), "reason": reason,
    }  # fmt: skip
