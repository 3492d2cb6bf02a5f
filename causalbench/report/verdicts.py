"""Verdicts on what a run set out to show: `verdicts.csv`.

Planned cells are the denominator: where a cell of a comparison is missing, failed or diverged, there is no verdict.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from causalbench.report.comparison import compare, holm, log_rank_scores
from causalbench.report.judged import AREA, STEPS, Judged
from causalbench.report.verdict_words import sentence
from causalbench.store.cells import StoredCell
from causalbench.store.statements import Stated
from causalbench.suite.hypotheses import Hypothesis, Statement

Row = dict[str, Any]
Key = tuple[str, str, int]


@dataclass(frozen=True)
class Finished:
    """What the finished cells of a run say, by method, backend and seed, and how all its cells stand."""

    results: Mapping[Key, list[Row]]
    states: Mapping[Key, str]

    @classmethod
    def of(cls, results: Iterable[Row], cells: Iterable[StoredCell]) -> Finished:
        """From rows of `results.csv` and the cells of a run."""
        found: dict[Key, list[Row]] = {}
        for row in results:
            found.setdefault((row["method"], row["backend"], row["seed"]), []).append(row)
        states = {(c.method, c.backend, c.seed): c.status.state for c in cells if c.kind == "learner"}
        return cls(found, states)


def verdict_rows(results: Iterable[Row], cells: Iterable[StoredCell], stated: Iterable[Stated]) -> list[Row]:
    """Rows of `verdicts.csv`: each hypothesis on all backends together and on each.

    A measure is a family of its own, in which Holm's step-down keeps the chance of any wrong verdict at 5%.
    """
    finished = Finished.of(results, cells)
    return [_row(judged) for entry in stated for judged in decide(entry, finished)]


def _row(judged: Judged) -> Row:
    compared, area = judged.comparison, judged.measure == AREA
    low, high = judged.interval or (None, None)
    return {
        "hypothesis": judged.hypothesis.text,
        "stated": int(judged.stated),
        "backend": judged.backend,
        "measure": judged.measure,
        "verdict": judged.verdict,
        "difference": judged.difference,
        "low": low,
        "high": high,
        "p_value": judged.p_value,
        "p_adjusted": judged.adjusted,
        "n_a": judged.sizes[0],
        "n_b": judged.sizes[1],
        "seeds_missing": judged.missing,
        "seed_correlation": compared.correlation if compared and area else None,
        "paired": int(compared.paired) if compared else None,
        "detectable": compared.detectable if compared and area else None,
        "sentence": sentence(judged),
    }


def decide(entry: Stated, finished: Finished, looks: int | None = None) -> list[Judged]:
    """The hypotheses of one statement: on success areas first, then, as a secondary measure, on steps to 90%.

    A statement with looks is judged as after the first `looks` of them, by default after all that were begun.
    """
    hypotheses = [Hypothesis.parse(text) for text in entry.statement.hypotheses]
    ordered = [h for h in hypotheses if h.within is None]
    family = partial(_family, statement=entry.statement, finished=finished, looks=looks)
    return [*family(AREA, hypotheses, entry.before_any_cell), *family(STEPS, ordered, False)]


def boards(statement: Statement) -> dict[str, tuple[str, ...]]:
    """Name of a board -> its backends: all together if there are several, and each."""
    each: dict[str, tuple[str, ...]] = {name: (name,) for name in statement.backends}
    return {"all": statement.backends} | each if len(each) > 1 else each


def begun(statement: Statement, finished: Finished, look: int) -> bool:
    """Whether any cell of the seeds that a look, numbered from 1, adds to those before it has been started."""
    bounds = (0, *statement.looks)
    added = set(statement.seeds[bounds[look - 1] : bounds[look]])
    return any(seed in added for _, _, seed in finished.states)


def asked_for(statement: Statement, finished: Finished) -> tuple[int, ...]:
    """The seeds that a run had to play: of one that may stop at a look, those up to the last look that was begun."""
    last = max((n for n in range(1, len(statement.looks) + 1) if begun(statement, finished, n)), default=1)
    return statement.seeds[: statement.looks[last - 1]] if statement.looks else statement.seeds


def _family(
    measure: str, hypotheses: Sequence[Hypothesis], stated: bool, *, statement: Statement, finished: Finished,
    looks: int | None,
) -> list[Judged]:  # fmt: skip
    """What is decided at a look stays decided; each look has its share of the 5%, and tests only what is open."""
    asked = [(hypothesis, *board) for hypothesis in hypotheses for board in boards(statement).items()]
    counts = statement.looks or (len(statement.seeds),)
    judged: list[Judged] = []
    for number, seeds in enumerate(counts[:looks], start=1):
        if number > 1 and not begun(statement, finished, number):
            break
        chosen, among = statement.seeds[:seeds], len(asked) * len(counts)
        now = [
            judged[index] if judged and judged[index].decided
            else _compared(measure, hypothesis, name, members, chosen, stated, among, finished)
            for index, (hypothesis, name, members) in enumerate(asked)
        ]  # fmt: skip
        judged = _adjusted(now, len(counts))
    return judged


def _adjusted(judged: Sequence[Judged], looks: int) -> list[Judged]:
    """Holm's step-down on what is not decided yet."""
    open_ = [index for index, one in enumerate(judged) if not one.decided]
    found = list(judged)
    for index, p in zip(open_, holm([judged[index].p_value for index in open_]), strict=True):
        found[index] = replace(judged[index], adjusted=None if p is None else min(1.0, p * looks))
    return found


def _compared(
    measure: str, hypothesis: Hypothesis, name: str, members: Sequence[str], seeds: Sequence[int], stated: bool,
    comparisons: int, finished: Finished,
) -> Judged:  # fmt: skip
    methods = hypothesis.left, hypothesis.right
    rows = [[[finished.results.get((m, b, s), []) for s in seeds] for b in members] for m in methods]
    sizes = tuple(sum(len(found) == 1 for backend in method for found in backend) for method in rows)
    planned = len(seeds) * len(members)
    judged = Judged(
        hypothesis, name, measure, stated, (sizes[0], sizes[1]), 2 * planned - sum(sizes), comparisons,
        obstacle=_obstacle(methods, members, seeds, finished),
    )  # fmt: skip
    if judged.obstacle:
        return judged
    values = [[[found[0][measure] for found in backend] for backend in method] for method in rows]
    if measure == AREA:
        left, right = ([np.array(backend) for backend in method] for method in values)
        compared = compare(left, right, comparisons)
        return replace(judged, comparison=compared, difference=compared.shifts.difference)
    scores = [log_rank_scores([a, b]) for a, b in zip(*values, strict=True)]
    budget = rows[0][0][0][0]["budget"]
    mean = [np.mean([[budget if s is None else min(s, budget) for s in b] for b in method]) for method in values]
    left, right = ([pair[side] for pair in scores] for side in (0, 1))
    return replace(judged, comparison=compare(left, right, comparisons), difference=float(mean[1] - mean[0]))


def _obstacle(methods: Sequence[str], members: Sequence[str], seeds: Sequence[int], finished: Finished) -> str:
    """Why two methods cannot be compared, in words; "" if they can."""
    for backend in members:
        for method in methods:
            keys = [(method, backend, seed) for seed in seeds]
            if any(len(finished.results.get(key, ())) > 1 for key in keys):
                return f"{method} stands at several points of a grid on {backend}"
            if lacking := [key for key in keys if key not in finished.results]:
                states = Counter(finished.states.get(key, "not started") for key in lacking)
                told = ", ".join(f"{count} {state}" for state, count in sorted(states.items()))
                return f"{len(lacking)} of {len(keys)} cells of {method} on {backend} are not finished ({told})"
    here = [row for key, rows in finished.results.items() if key[0] in methods and key[1] in members for row in rows]
    if len({row["budget"] for row in here}) > 1:
        return "areas under curves of different budgets are not averaged"
    return ""
