"""How a run stands, read from its folder alone: `causalbench status`, also of a run that another command works on."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from causalbench.errors import RunFolderError
from causalbench.store.cell_progress import CellProgress, read_cell_progress
from causalbench.store.cells import StoredCell
from causalbench.store.claim import Holder, holder
from causalbench.store.run_folder import RunFolder

AT_AN_END = ("done", "diverged", "timeout", "skipped")
BAD = ("failed", "diverged", "timeout", "damaged")


@dataclass(frozen=True)
class Running:
    """A cell that is being worked on; `left` is in seconds, None before anything can be said."""

    cell: str
    backend: str
    method: str
    seed: int
    fraction: float
    left: float | None
    text: str


@dataclass(frozen=True)
class Failure:
    """A cell that ended badly, why, and its log."""

    cell: str
    state: str
    reason: str
    log: str


@dataclass(frozen=True)
class RunStatus:
    """`planned` cells in all and how many stand how; `left` seconds until the end, None if that cannot be said.

    `holder` is None when nobody works on the run; its `running` cells were then interrupted, and go on when it does.
    """

    folder: str
    planned: int
    states: dict[str, int]
    fraction: float
    left: float | None
    holder: Holder | None
    running: list[Running]
    failures: list[Failure]


def run_status(run: RunFolder) -> RunStatus:
    """How the run stands now. Raises `RunFolderError` for a folder that is no run's."""
    cells, held = run.cells(), holder(run.path)
    sessions = run.sessions()
    if not cells and not sessions and held is None:
        raise RunFolderError(f"{run.path}: no run here; give the folder that `causalbench run` writes")
    said = (session.get("cells") for session in sessions)
    planned = max([len(cells), *(number for number in said if isinstance(number, int))])
    states = Counter[str](cell.status.state for cell in cells)
    states["pending"] += planned - len(cells)
    progress = {cell.id: read_cell_progress(cell.folder) for cell in cells if cell.status.state == "running"}
    ended = sum(states[state] for state in AT_AN_END)
    share = sum(found.fraction for found in progress.values() if found)
    return RunStatus(
        folder=str(run.path),
        planned=planned,
        states={state: number for state, number in sorted(states.items()) if number},
        fraction=(ended + share) / planned if planned else 0.0,
        left=_left(cells, progress, states["pending"]) if held else None,
        holder=held,
        running=[_running(cell, progress[cell.id]) for cell in cells if cell.id in progress],
        failures=[_failure(cell, run.path) for cell in cells if cell.status.state in BAD],
    )


def _running(cell: StoredCell, found: CellProgress | None) -> Running:
    now = found or CellProgress(0.0, 0.0, 0.0)
    return Running(cell.id, cell.backend, cell.method or "discovery", cell.seed, now.fraction, now.left, now.text)


def _failure(cell: StoredCell, folder: Path) -> Failure:
    return Failure(cell.id, cell.status.state, cell.status.reason, str(cell.folder.relative_to(folder) / "log.txt"))


def _left(cells: Sequence[StoredCell], progress: dict[str, CellProgress | None], waiting: int) -> float | None:
    """Seconds until all is done: what runs and what waits, as many at a time as now, at the speed that was seen."""
    own = [found.left for found in progress.values() if found and found.left is not None]
    if waiting == 0 and len(own) == len(progress):
        return max(own, default=0.0)
    whole = [cell.status.seconds for cell in cells if cell.status.state == "done"]
    whole += _whole(progress.values())
    if not whole:
        return None
    typical = statistics.fmean(whole)
    unknown = waiting + len(progress) - len(own)
    return (sum(own) + typical * unknown) / max(len(progress), 1)


def _whole(running: Iterable[CellProgress | None]) -> list[float]:
    """Seconds that running cells will have taken in all, as far as can be said."""
    return [found.seconds + found.left for found in running if found and found.left is not None]
