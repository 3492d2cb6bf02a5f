"""`reversals.csv` beside the results of a learner cell: whose doing the reversals of its policy are.

`causalbench reversals` writes it when the cell is finished, from its policy; it is no result of the cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from causalbench.core.learners.records import ReversalCauses
from causalbench.store.files import is_file
from causalbench.store.records import reading, table_rows, write_rows

REVERSALS = "reversals.csv"
NAMES = tuple(field.name for field in fields(ReversalCauses))
COLUMNS = ("causes_graph", *NAMES)


def write_reversals(folder: Path, graph: str, rows: Sequence[ReversalCauses]) -> None:
    """Write the `reversals.csv` of the cell in `folder`; `graph` is the hash of the graph whose causes are meant."""
    plain = ({name: int(value) for name, value in asdict(row).items()} for row in rows)
    write_rows(folder / REVERSALS, COLUMNS, ({"causes_graph": graph} | row for row in plain))


def read_reversals(folder: Path) -> list[dict[str, str | int]]:
    """Rows of the `reversals.csv` of the cell in `folder`; none where nobody asked.

    Raises `DamagedFileError` for anything but what `write_reversals` wrote.
    """
    path = folder / REVERSALS
    if not is_file(path):
        return []
    with reading(path):
        return [
            {"causes_graph": row["causes_graph"]} | {name: int(row[name]) for name in NAMES}
            for row in table_rows(path, COLUMNS)
        ]
