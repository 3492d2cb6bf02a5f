"""What a run need not try again and again: a backend on which cell after cell fails in the same way from the start."""

from __future__ import annotations

import re
from collections import defaultdict

from causalbench.store.cells import PROGRESS_TABLE, Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, DiscoveryCell

ENOUGH = 3
"""Cells that fail alike before their first evaluation until the rest is skipped."""


class GivingUp:
    """Looks at how cells end and says which of the others need not start.

    Failures of one method alone are laid to it, and only its cells are skipped; those of several are the backend's.
    """

    def __init__(self, run: RunFolder) -> None:
        self.run = run
        self._failed: dict[tuple[str, str], list[str]] = defaultdict(list)  # (backend, how) -> the methods that did
        self._reasons: dict[tuple[str, str], str] = {}

    def ended(self, cell: Cell, status: Status) -> None:
        """Take in how `cell` ended."""
        if status.state == "failed" and not (self.run.folder(cell) / PROGRESS_TABLE).exists():
            key = (cell.backend.name, re.sub(r"[0-9]+", "#", status.reason))
            self._failed[key].append(_method(cell))
            self._reasons[key] = status.reason

    def reason(self, cell: Cell) -> str:
        """Why `cell` need not start, in a sentence; "" if it should."""
        for key, methods in self._failed.items():
            laid_to_it = len(set(methods)) > 1 or _method(cell) in methods
            if key[0] == cell.backend.name and len(methods) >= ENOUGH and laid_to_it:
                return (
                    f"{len(methods)} cells on {key[0]} failed alike before their first evaluation "
                    f"({self._reasons[key]}); the same command tries again"
                )
        return ""


def _method(cell: Cell) -> str:
    return "" if isinstance(cell, DiscoveryCell) else cell.method.name
