"""What all tasks have in common: which terms are active in which stage, and how stages add up to a potential."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stage_task import Term


def active_terms(terms: tuple[Term, ...], n_stages: int) -> NDArray[np.bool_]:
    """Return a table, bool (n_stages + 1, n_terms). Row i says which terms belong to stage i; row 0 is unused."""
    table = np.zeros((n_stages + 1, len(terms)), dtype=bool)
    for column, term in enumerate(terms):
        table[list(term.stages), column] = True
    return table


def staged_potential(
    stage: NDArray[np.int64], left: Sequence[NDArray[Any]], most: Sequence[float], bonus: float
) -> NDArray[np.float64]:
    """Return a potential (...) for `StageTask.potential`, from what the terms of each stage would still pay.

    `left` has for each stage an array (...) of what its progress terms would still pay until its end, and `most` what
    they pay at most; further away the potential of the stage is 0. A later stage adds `bonus` and all of the stages
    before it, so that a step forward always gains and a step back always loses.
    """
    before = np.concatenate([[0.0], np.cumsum(np.array(most[:-1]) + bonus)])
    done = np.maximum(np.array(most) - np.stack(np.broadcast_arrays(*left), axis=-1), 0.0)
    here = np.take_along_axis(done, np.asarray(stage)[..., None] - 1, axis=-1)[..., 0]
    out: NDArray[np.float64] = before[np.asarray(stage) - 1] + here
    return out
