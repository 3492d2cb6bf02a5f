"""What a cell may take: the time and memory that the user says, or else what cells like it took, times a factor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from causalbench.suite.cells import Cell, DiscoveryCell

FACTOR = 10.0
"""Times the longest that a cell like it took in this run."""
FLOOR = 3_600.0
"""Seconds that a derived limit has at least."""
SILENCE = 4 * 3_600.0
"""Seconds that a cell may go without any progress: many times the longest evaluation of a slow simulator."""
RAISE = "; another limit: --timeout MINUTES, with --retry-failed"


@dataclass(frozen=True)
class Limit:
    """Seconds that a cell may take, and that it may go without progress, with a sentence for each; bytes of memory."""

    seconds: float
    silence: float
    sentence: str
    silent: str = f"no progress for {SILENCE / 3600:.0f} hours{RAISE}"
    memory: float = math.inf


class Limits:
    """The limit of each cell. With `timeout`, in seconds, it is that, and no other of time; `memory` is in bytes."""

    def __init__(self, timeout: float | None, memory: float = math.inf) -> None:
        self.timeout, self.memory = timeout, memory
        self._longest: dict[tuple[str, ...], float] = {}

    def took(self, cell: Cell, seconds: float) -> None:
        """Take in how long a finished cell took on this machine."""
        self._longest[_like(cell)] = max(seconds, self._longest.get(_like(cell), 0.0))

    def of(self, cell: Cell) -> Limit:
        """The limit of `cell` as far as is known now."""
        if self.timeout is not None:
            return Limit(self.timeout, math.inf, "stopped at the time limit of --timeout", memory=self.memory)
        longest = self._longest.get(_like(cell))
        if longest is None:
            return Limit(math.inf, SILENCE, "", memory=self.memory)
        seconds = max(FLOOR, FACTOR * longest)
        told = f"stopped after {seconds / 60:.0f} minutes, where such a cell took {longest / 60:.1f}{RAISE}"
        return Limit(seconds, SILENCE, told, memory=self.memory)


def _like(cell: Cell) -> tuple[str, ...]:
    """What cells have in common that take about as long: one suite gives all of them the same settings."""
    if isinstance(cell, DiscoveryCell):
        return (cell.backend.name, "", *map(str, cell.grid_point.items()))
    return (cell.backend.name, cell.method.name, *map(str, cell.grid_point.items()))
