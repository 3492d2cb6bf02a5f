"""What a page is made from: the cells of a run folder, their tables, and what the folder says of its sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from causalbench.errors import RunFolderError
from causalbench.report.frames import Results, frames_of
from causalbench.report.tables import Table, tables
from causalbench.store.cells import StoredCell
from causalbench.store.run_folder import RunFolder


@dataclass(frozen=True)
class Source:
    """Everything that sections read; `problems` are sentences about what is damaged, and so not counted.

    `found` are the tables of the run by file, `tables` the same as frames.
    """

    run: RunFolder
    cells: Sequence[StoredCell]
    found: Mapping[str, Table]
    tables: Results
    problems: Sequence[str]
    sessions: Sequence[Mapping[str, Any]]
    known_gaps: Mapping[str, Mapping[str, str]]

    @property
    def backends(self) -> list[str]:
        """Names of all backends, in order."""
        return sorted({cell.backend for cell in self.cells})

    @property
    def methods(self) -> list[str]:
        """Names of all methods, in order."""
        return sorted({cell.method for cell in self.cells if cell.method})

    @property
    def discoveries(self) -> list[StoredCell]:
        """The finished discoveries."""
        return [cell for cell in self.cells if cell.is_done("discovery")]

    @property
    def learned(self) -> list[StoredCell]:
        """The finished learner cells."""
        return [cell for cell in self.cells if cell.is_done("learner")]


def read_source(folder: Path, found: Mapping[str, Table] | None = None) -> Source:
    """What the run in `folder` says; `found` are its tables, made anew if None.

    Raises `RunFolderError` for a folder without cells.
    """
    run = RunFolder(folder)
    cells = run.cells()
    problems = run.problems()
    if not cells:
        reason = "; ".join(problems) or "no cells here; give the folder that `causalbench run` wrote"
        raise RunFolderError(f"{folder}: {reason}")
    found = tables(cells, run.stated()) if found is None else found
    frames = vars(frames_of(found))
    grouped = Results(**{name: _grouped(frame) for name, frame in frames.items()})
    return Source(run, cells, found, grouped, problems, run.sessions(), run.known_gaps())


def _grouped(frame: pd.DataFrame) -> pd.DataFrame:
    """`frame` with an empty text where there is no grid, so that rows can be grouped by it."""
    return frame.assign(grid_point=frame["grid_point"].fillna("")) if "grid_point" in frame else frame
