"""Tables beside the results of a learner cell, which later commands make of its policy; they are no results of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from causalbench.core.learners.records import ReversalCauses, Transfer
from causalbench.store.files import is_file
from causalbench.store.records import reading, table_rows, write_rows

Record = ReversalCauses | Transfer

REVERSALS, TRANSFER = "reversals.csv", "transfer.csv"
BESIDE: Mapping[str, type[Record]] = {REVERSALS: ReversalCauses, TRANSFER: Transfer}
"""File -> what a row of it is: `causalbench reversals` and `causalbench transfer` write them."""
READ: Mapping[str, Callable[[str], Any]] = {"str": str, "int": int, "float": float, "bool": int}
"""Type of a field -> what makes a value of its text; truth is 1 and 0, as in every table."""


def write_beside(folder: Path, file: str, rows: Sequence[Record]) -> None:
    """Write `file` into the folder of a cell."""
    plain = [
        {name: int(value) if isinstance(value, bool) else value for name, value in asdict(row).items()} for row in rows
    ]
    write_rows(folder / file, [field.name for field in fields(BESIDE[file])], plain)


def read_beside(folder: Path, file: str) -> list[dict[str, Any]]:
    """The rows of `file` in the folder of a cell; none where nobody asked for it.

    Raises `DamagedFileError` for anything but what `write_beside` wrote.
    """
    if not is_file(folder / file):
        return []
    types = {field.name: READ[str(field.type)] for field in fields(BESIDE[file])}
    with reading(folder / file):
        return [
            {name: make(row[name]) for name, make in types.items()} for row in table_rows(folder / file, tuple(types))
        ]
