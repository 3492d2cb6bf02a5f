"""`progress.json` of a running cell: how far it is, for `causalbench status` in another process or on another node.

It is no result: it is written every few seconds at most, and gone when the cell ends.
"""

from __future__ import annotations

import json
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le

from causalbench.errors import DamagedFileError
from causalbench.store.files import read_json, validated

PROGRESS = "progress.json"
INTERVAL = 2.0  # s between two writes


@dataclass(frozen=True)
class CellProgress:
    """A share in [0, 1], the seconds that this attempt has taken for it, and what it was at its beginning."""

    fraction: Annotated[float, Ge(0), Le(1)]
    seconds: Annotated[float, Ge(0)]
    began_at: Annotated[float, Ge(0), Le(1)]
    text: str = ""

    @property
    def left(self) -> float | None:
        """Seconds until its end at the speed of this attempt; None before anything can be said."""
        done = self.fraction - self.began_at
        return self.seconds / done * (1 - self.fraction) if done > 0 else None


class ProgressFile:
    """Keeps the newest progress of a cell in its folder. A folder that is gone or full is no reason to end a cell."""

    def __init__(self, folder: Path) -> None:
        self.path, self._started, self._next = folder / PROGRESS, time.monotonic(), 0.0
        self._began_at: float | None = None

    def write(self, fraction: float, text: str) -> None:
        """Replace the file, unless that was done just now. One short write, which a reader sees whole or not at all."""
        now = time.monotonic()
        if self._began_at is None:
            self._began_at, self._next = fraction, now + INTERVAL
        if now < self._next:
            return
        self._next = now + INTERVAL
        newest = CellProgress(fraction, now - self._started, self._began_at, text)
        with suppress(OSError):
            self.path.write_text(json.dumps(asdict(newest)), encoding="utf-8")

    def close(self) -> None:
        """Delete the file."""
        with suppress(OSError):
            self.path.unlink(missing_ok=True)


def read_cell_progress(folder: Path) -> CellProgress | None:
    """How far the cell in `folder` is; None where it says nothing, or something else."""
    try:
        return validated(folder / PROGRESS, CellProgress, read_json(folder / PROGRESS))
    except DamagedFileError:
        return None
