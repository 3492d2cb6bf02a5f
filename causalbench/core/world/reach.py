"""What a task asks of an arm's reach, for the scan that finds a robot's workspace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace

Tilts = tuple[tuple[float, float], ...]
"""Postures of a hand: pitch, by which it points forward of straight down, and roll, both rad."""


@dataclass(frozen=True)
class ReachDemands:
    """Poses that a hand must take around a box on the table, and the starts of a task.

    `rise` m is from the table to the box's centre. Of each of `poses`, a height m above that centre and tilts, all must
    be in reach with the hand off the centre by `offset` m along x and y, either way. `tilts` are those that a start may
    have. `draw_start(rng, workspace, max_opening)` draws one; `is_start(facts)` says whether a world is in one.
    """

    rise: float
    offset: float
    poses: tuple[tuple[float, Tilts], ...]
    tilts: Tilts
    draw_start: Callable[[np.random.Generator, Workspace, float], Layout]
    is_start: Callable[[Facts], bool]
