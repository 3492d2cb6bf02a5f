"""What a learner cell reports, as files: `progress.csv`, one row an evaluation, and `counts.json`."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from causalbench.atomic import write_json, write_text
from causalbench.core.discovery.edges import ORACLE
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.errors import DamagedFileError
from causalbench.store.files import read_json, validated

RETURN = "return_"
"""Prefix of the columns of `progress.csv` that hold a reward term's mean return."""


@dataclass(frozen=True)
class Counts:
    """A training run as a whole: totals, and what its graph was and took; `graph` is "" if it used none."""

    env_steps: int
    episodes: int
    successes: int
    reversals: int
    long_reversals: int
    transitions: Sequence[tuple[int, int, int]]  # (from stage, to stage, env steps), those that happened
    reached: Mapping[str, int]  # stage -> episodes that reached it
    updates: Mapping[str, int]  # stage -> gradient updates
    graph: str
    discovery_env_steps: int


def write_progress(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Replace `progress.csv` by the evaluations so far, one a row; `episodes.csv` has what was played."""
    rows = [
        {key: value for key, value in vars(evaluation).items() if key not in ("term_returns", "played")}
        | {RETURN + term: value for term, value in evaluation.term_returns.items()}
        for evaluation in evaluations
    ]
    write_rows(path, list(rows[0]), rows)


def read_progress(path: Path) -> list[Evaluation]:
    """What `write_progress` wrote, at least one evaluation; floats come back bit for bit.

    Raises `DamagedFileError` for anything else, as all that reads here.
    """
    with reading(path):
        return [_evaluation(row) for row in table_rows(path)]


def _evaluation(row: dict[str, str]) -> Evaluation:
    returns = {key.removeprefix(RETURN): float(value) for key, value in row.items() if key.startswith(RETURN)}
    plain: dict[str, Any] = {key: float(value) for key, value in row.items() if not key.startswith(RETURN) and value}
    counts = {key: int(row[key]) for key in ("env_steps", "episodes")}
    return Evaluation(**({"held_rate": None, "success_sampled": None} | plain | counts), term_returns=returns)


def read_effects(path: Path) -> dict[tuple[int, str, str], dict[str, str]]:
    """(stage, term, action) -> what `oracle.csv` says of the edge, as it stands there.

    Its columns are `ORACLE`, each with the prefix "oracle_".
    """
    with reading(path):
        return {
            (int(row["stage"]), row["term"], row["action"]): {f"oracle_{name}": row[name] for name in ORACLE}
            for row in table_rows(path)
        }


def write_counts(path: Path, counts: TrainingCounts, graph: CausalGraph | None) -> None:
    """Write `counts.json`."""
    table = counts.transitions
    record = Counts(
        env_steps=int(counts.env_steps),
        episodes=int(counts.episodes),
        successes=int(counts.successes),
        reversals=int(counts.reversals),
        long_reversals=int(counts.long_reversals),
        transitions=[(int(i), int(j), int(table[i, j])) for i, j in zip(*table.nonzero(), strict=True)],
        reached={str(stage): int(n) for stage, n in sorted(counts.reached.items())},
        updates={str(stage): int(n) for stage, n in sorted(counts.updates.items())},
        graph=graph.hash if graph else "",
        discovery_env_steps=graph.env_steps if graph else 0,
    )
    write_json(path, dataclasses.asdict(record))


def read_counts(path: Path) -> Counts:
    """What `write_counts` wrote."""
    return validated(path, Counts, read_json(path))


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Whatever goes wrong in the block is a `DamagedFileError` that names `path`."""
    try:
        yield
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise DamagedFileError(f"{path}: not the table that was written ({error!r})") from error


def table_rows(path: Path, columns: Sequence[str] = ()) -> list[dict[str, str]]:
    """The rows of a CSV file as texts.

    Raises `ValueError` unless the table has rows or, at least, begins with all of `columns`.
    """
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file, strict=True)
        rows = list(reader)
        found = tuple(reader.fieldnames or ())
    if not rows and (not columns or found[: len(columns)] != tuple(columns)):
        raise ValueError("no rows")
    if any(None in row or None in row.values() for row in rows):  # DictReader's for what is too much or too little
        raise ValueError("a row of another length")
    return rows


def write_rows(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Replace the CSV file `path` by `csv_text`."""
    write_text(path, csv_text(columns, rows))


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """A table as CSV; None is an empty cell, floats are written so that they read back bit for bit.

    Text that a spreadsheet would take for a formula gets an apostrophe before it.
    """
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _no_formula(value) for name, value in row.items()} for row in rows)
    return buffer.getvalue()


def _no_formula(value: Any) -> Any:
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
