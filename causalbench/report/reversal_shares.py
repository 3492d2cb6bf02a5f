"""The share of reversals that vanish without some actions, with an interval over episodes.

Reversals of one episode come in bursts and are not independent, so that whole episodes are drawn anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy.stats
from numpy.typing import NDArray

from causalbench.report.stats import ALPHA

FEWEST = 10
"""Episodes with a reversal; fewer give no interval."""
RESAMPLES = 2_000


class Share(NamedTuple):
    """`share` of reversals, and a 95% interval, NaN where too few episodes have a reversal."""

    share: float
    low: float
    high: float


def vanished_share(rows: pd.DataFrame, vanished: str) -> Share:
    """The share of the reversals in `rows` of `reversals.csv` that the column `vanished` counts; NaN without any."""
    episodes = rows.groupby(["seed", "deterministic", "episode"])[[vanished, "reversals"]].sum()
    found = episodes[episodes["reversals"] > 0].to_numpy(np.float64)
    if not len(found):
        return Share(np.nan, np.nan, np.nan)
    share = float(found[:, 0].sum() / found[:, 1].sum())
    return Share(share, *_interval(found)) if len(found) >= FEWEST else Share(share, np.nan, np.nan)


def _interval(found: NDArray[np.float64]) -> tuple[float, float]:
    """Of (n, 2) vanished and all reversals of each episode."""

    def ratio(vanished: NDArray[np.float64], reversals: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
        shares: NDArray[np.float64] = vanished.sum(axis) / reversals.sum(axis)
        return shares

    drawn = scipy.stats.bootstrap(
        (found[:, 0], found[:, 1]), ratio, paired=True, vectorized=True, n_resamples=RESAMPLES,
        confidence_level=1 - ALPHA, method="percentile", rng=np.random.default_rng(0),
    )  # fmt: skip
    return float(drawn.confidence_interval.low), float(drawn.confidence_interval.high)
