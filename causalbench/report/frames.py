"""A run's tables as pandas frames: `causalbench.load_results`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import pandas as pd

from causalbench.errors import RunFolderError
from causalbench.report.columns import COLUMNS
from causalbench.report.tables import Table, tables
from causalbench.store.run_folder import RunFolder


@dataclass(frozen=True)
class Results:
    """The tables of a run, named like its CSV files; their columns are those of `docs/reference/tables.md`."""

    results: pd.DataFrame
    curves: pd.DataFrame
    returns: pd.DataFrame
    stages: pd.DataFrame
    episodes: pd.DataFrame
    stage_account: pd.DataFrame
    moves: pd.DataFrame
    progress_account: pd.DataFrame
    latching: pd.DataFrame
    reversals: pd.DataFrame
    transfer: pd.DataFrame
    discovery: pd.DataFrame
    leaderboard: pd.DataFrame
    verdicts: pd.DataFrame
    agreement: pd.DataFrame
    looks: pd.DataFrame
    timing: pd.DataFrame


def load_results(folder: str | PathLike[str]) -> Results:
    """Read the tables of the run in `folder` as pandas frames. Each file is checked against its SHA-256.

    Only finished cells are in them. A missing value is `pandas.NA`. Raises `RunFolderError` for a folder without cells
    and for damaged files, which it names.
    """
    run = RunFolder(Path(folder))
    if problems := run.problems():
        raise RunFolderError("; ".join(problems))
    cells = run.cells()
    if not cells:
        raise RunFolderError(f"{folder}: no cells here; give the folder that `causalbench run` wrote")
    return frames_of(tables(cells, run.stated()))


def frames_of(found: Mapping[str, Table]) -> Results:
    """`tables` as frames."""
    frames = {Path(file).stem: _frame(columns, rows) for file, (columns, rows) in found.items()}
    return Results(**frames)


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of `frame`; None for a missing value."""
    plain = frame.astype(object).where(frame.notna(), None)
    return [{str(key): value for key, value in row.items()} for row in plain.to_dict("records")]


def _frame(columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    frame = pd.DataFrame.from_records(list(rows), columns=list(columns))
    return frame.replace({"": pd.NA}).astype({name: COLUMNS[name].dtype for name in columns if name in COLUMNS})
