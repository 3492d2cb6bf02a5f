"""Whether backends rank methods alike."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import scipy.stats

Row = dict[str, Any]


def agreement(board: Sequence[Row]) -> list[Row]:
    """Rows of `agreement.csv` from those of `leaderboard.csv`: every two backends that rank two methods or more."""
    areas: dict[str, dict[tuple[str, str], float]] = {}
    for row in board:
        if row["backend"] != "all" and row.get("rank") is not None:
            areas.setdefault(row["backend"], {})[row["method"], row["grid_point"]] = row["success_auc_iqm"]
    rows = []
    for (one, first), (other, second) in combinations(areas.items(), 2):
        shared = [who for who in first if who in second]
        if len(shared) < 2:
            continue
        found = scipy.stats.kendalltau([first[who] for who in shared], [second[who] for who in shared])
        tau, p = (None if np.isnan(value) else float(value) for value in (found.statistic, found.pvalue))
        row = {"backend": one, "other_backend": other, "methods": len(shared)}
        rows.append(row | {"kendall_tau": tau, "p_value": p})
    return rows
