"""What a person sees while cells run: a live table in a terminal, lines elsewhere, nothing with --quiet."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table

from causalbench.run.cell import Progress
from causalbench.run.view import Silent, View
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, DiscoveryCell

COLOURS = {
    "done": "green",
    "failed": "red",
    "diverged": "red",
    "timeout": "red",
    "skipped": "yellow",
    "running": "cyan",
}


def choose_view(quiet: bool, console: Console) -> View:
    """The view that fits `console`."""
    if quiet:
        return Silent()
    return TableView(console) if console.is_terminal else LineView(console)


class LineView:
    """A line for every tenth of a cell and for its end."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.tenths: dict[str, int] = {}
        self.started, self.to_do, self.ended = 0.0, 0, 0

    def note(self, sentence: str) -> None:
        """A line of its own."""
        self._print(sentence)

    def begin(self, cells: Sequence[Cell], to_do: Sequence[Cell], run: RunFolder) -> None:
        """Say how much there is to do."""
        self.started, self.to_do, self.ended = time.monotonic(), len(to_do), 0
        self._print(f"{len(to_do)} of {len(cells)} cells to run in {run.path}")

    def on_progress(self, cell: Cell, progress: Progress) -> None:
        """Print a line when another tenth is done."""
        tenth = int(10 * progress.fraction)
        if tenth > self.tenths.get(cell.id, 0):
            self.tenths[cell.id] = tenth
            self._print(f"{label(cell)}: {10 * tenth}% {progress.text}{_figures(progress)}")

    def on_outcome(self, cell: Cell, status: Status) -> None:
        """Print how the cell ended, and when the rest will have at the speed so far."""
        self.ended += 1
        reason = f"{': ' * bool(status.reason)}{status.reason}"
        self._print(f"{label(cell)}: {status.state} after {status.seconds:.1f} s{reason}")
        if left := self.to_do - self.ended:
            seconds = (time.monotonic() - self.started) / self.ended * left
            self._print(f"{left} of {self.to_do} cells to go, about {duration(seconds)}")

    def end(self) -> None:
        """Nothing."""

    def _print(self, text: str) -> None:
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)


class TableView:
    """One line per cell: state, progress, latest success and reversals, time left."""

    def __init__(self, console: Console) -> None:
        self.cells: Sequence[Cell] = ()
        self.statuses: dict[str, Status] = {}
        self.progress: dict[str, Progress] = {}
        self.started: dict[str, float] = {}
        self.console = console
        self.live = Live(console=console, get_renderable=self._table, refresh_per_second=4)  # draws at once

    def note(self, sentence: str) -> None:
        """A line above the table."""
        self.console.print(sentence, markup=False, highlight=False, soft_wrap=True)

    def begin(self, cells: Sequence[Cell], to_do: Sequence[Cell], run: RunFolder) -> None:
        """Show the table."""
        self.cells = cells
        waiting = {cell.id for cell in to_do}
        self.statuses = {cell.id: Status("pending") if cell.id in waiting else run.status(cell) for cell in cells}
        self.live.start()

    def on_progress(self, cell: Cell, progress: Progress) -> None:
        """Remember it for the next refresh."""
        self.started.setdefault(cell.id, time.monotonic())
        self.statuses[cell.id] = Status("running")
        self.progress[cell.id] = progress

    def on_outcome(self, cell: Cell, status: Status) -> None:
        """Remember it for the next refresh."""
        self.statuses[cell.id] = status

    def end(self) -> None:
        """Leave the table on the screen as it stands."""
        self.live.stop()

    def _table(self) -> Table:
        table = Table("cell", "state", "progress", "success", "reversals/1000", "left", "")
        for cell in self.cells:
            status, progress = self.statuses[cell.id], self.progress.get(cell.id, Progress(0.0, ""))
            fraction = 1.0 if status.state == "done" else progress.fraction
            table.add_row(
                escape(label(cell)),
                f"[{COLOURS.get(status.state, 'dim')}]{status.state}",
                ProgressBar(total=1.0, completed=fraction, width=20),
                _number(progress.success),
                _number(progress.reversals_per_1000_steps),
                self._left(cell, progress) if status.state == "running" else "",
                escape(status.reason or progress.text),
            )
        return table

    def _left(self, cell: Cell, progress: Progress) -> str:
        if progress.fraction < 0.02:
            return ""
        return duration((time.monotonic() - self.started[cell.id]) * (1 / progress.fraction - 1))


def duration(seconds: float) -> str:
    """Such as 40 s, 12 min, 3.5 h."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 3600 else f"{seconds / 3600:.1f} h"


def label(cell: Cell) -> str:
    """A cell's name for people."""
    what = "discovery" if isinstance(cell, DiscoveryCell) else cell.method.name
    point = "".join(f", {key}={value}" for key, value in cell.grid_point.items())
    return f"{what} on {cell.backend.name}, seed {cell.seed}{point}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _figures(progress: Progress) -> str:
    if progress.success is None:
        return ""
    return f", success {progress.success:.2f}, {_number(progress.reversals_per_1000_steps)} reversals per 1000 steps"
