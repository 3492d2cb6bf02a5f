"""What a run that adds seeds says of given success areas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from causalbench.report.sequential import look_rows, with_looks
from causalbench.report.verdicts import verdict_rows
from causalbench.store.cells import State, Status, StoredCell
from causalbench.store.statements import Stated
from causalbench.suite.hypotheses import Statement


def statement(hypotheses: tuple[str, ...], backends: tuple[str, ...] = ("x", "y"), seeds: int = 10) -> Statement:
    return with_looks(Statement("s", "full", hypotheses, backends, tuple(range(100, 100 + seeds))))


def told(
    stated: Statement, areas: dict[str, list[float]], states: dict[tuple[str, str, int], State] | None = None
) -> tuple[list[dict[str, Any]], dict[tuple[str, str], dict[str, Any]]]:
    """Rows of looks.csv, and those of verdicts.csv on success areas; `areas` by method are the same on each backend."""
    results, cells = [], []
    for method, values in areas.items():
        for backend in stated.backends:
            for seed, area in zip(stated.seeds, values, strict=False):
                state = (states or {}).get((method, backend, seed), "done")
                identity = {"kind": "learner", "backend": {"name": backend}, "method": {"name": method}, "seed": seed}
                cells.append(StoredCell("cell", identity | {"grid_point": {}}, Status(state), Path("nowhere")))
                if state == "done":
                    row = {"method": method, "backend": backend, "seed": seed, "success_auc": area}
                    results.append(row | {"steps_to_90": None, "budget": 100})
    entry = Stated(stated, True)
    verdicts = [row for row in verdict_rows(results, cells, [entry]) if row["measure"] == "success_auc"]
    return look_rows(results, cells, [entry]), {(row["hypothesis"], row["backend"]): row for row in verdicts}
