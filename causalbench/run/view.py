"""What `run_plan` tells whoever watches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from causalbench.run.cell import Progress
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell


class View(Protocol):
    """Shows a run. Notes come first, then `begin`, and last `end`, also when it is interrupted or never began."""

    def note(self, sentence: str) -> None:
        """What a person should know before the cells run."""

    def begin(self, cells: Sequence[Cell], to_do: Sequence[Cell], run: RunFolder) -> None:
        """The whole plan and the part of it that will run."""

    def on_progress(self, cell: Cell, progress: Progress) -> None:
        """A running cell got further."""

    def on_outcome(self, cell: Cell, status: Status) -> None:
        """A cell ended."""

    def end(self) -> None:
        """No more is coming."""


class Silent:
    """Shows nothing."""

    def note(self, sentence: str) -> None:
        """Nothing."""

    def begin(self, cells: Sequence[Cell], to_do: Sequence[Cell], run: RunFolder) -> None:
        """Nothing."""

    def on_progress(self, cell: Cell, progress: Progress) -> None:
        """Nothing."""

    def on_outcome(self, cell: Cell, status: Status) -> None:
        """Nothing."""

    def end(self) -> None:
        """Nothing."""
