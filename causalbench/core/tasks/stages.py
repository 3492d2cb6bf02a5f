"""Which terms are active in which stage, for all tasks alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stage_task import Term


def active_terms(terms: tuple[Term, ...], n_stages: int) -> NDArray[np.bool_]:
    """Table (n_stages + 1, n_terms): row i says which terms belong to stage i; row 0 is unused."""
    table = np.zeros((n_stages + 1, len(terms)), dtype=bool)
    for column, term in enumerate(terms):
        table[list(term.stages), column] = True
    return table
