"""The grid of a suite: settings with several values each, every combination of which is run."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import Field

Grid = dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]]
"""Dotted key of a setting, such as `learner.learning_rate` or `discovery.kl.epsilon_cv` -> its values."""

Combination = Mapping[str, Any]
"""Dotted key -> one of its values."""

DISCOVERER = "discovery.discoverer"
"""The key that names who discovers; a method that names its own is the same at all of its values."""
TASK = "task"
"""The key of a grid whose values are tasks, in place of the suite's."""
DONOR, DONOR_TASK = "discovery.backend", "discovery.task"
"""Keys of a grid that are no settings: the backend, and the task, whose discovery gives a method its causal graph."""
OWN = "own"
"""What `DONOR_TASK` may name instead of a task: the one that the method learns."""
NAMES = (TASK, DONOR, DONOR_TASK)
"""Keys of a grid whose values are names, of no section's settings."""


def combinations(grid: Grid) -> Iterator[Combination]:
    """Every combination, the last key's values changing fastest; one empty combination for an empty grid."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def layer_of(combination: Combination) -> dict[str, dict[str, Any]]:
    """The settings of a combination as a suite would write them: section -> key -> value, with nested sections."""
    layer: dict[str, dict[str, Any]] = {"learner": {}, "discovery": {}, "evaluation": {}}
    for key, value in combination.items():
        if key in NAMES:
            continue
        *path, last = key.split(".")
        place = layer
        for part in path:
            place = place.setdefault(part, {})
        place[last] = value
    return layer
