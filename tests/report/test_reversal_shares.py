"""The share of reversals that vanish, against answers that are known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from causalbench.report.reversal_shares import FEWEST, vanished_share

COLUMN = "vanished_without_redundant"


def frame(vanished: list[int], reversals: list[int]) -> pd.DataFrame:
    """An episode each."""
    table = pd.DataFrame({COLUMN: vanished, "reversals": reversals})
    return table.assign(seed=0, deterministic=1, episode=range(len(table)), stage=2)


def test_the_share_is_of_all_reversals_not_of_episodes() -> None:
    assert vanished_share(frame([1, 0, 9], [1, 0, 19]), COLUMN).share == 0.5


def test_without_reversals_there_is_no_share_and_from_few_no_interval() -> None:
    assert np.isnan(vanished_share(frame([0, 0], [0, 0]), COLUMN)).all()
    found = vanished_share(frame([1] * (FEWEST - 1) + [0], [1] * (FEWEST - 1) + [0]), COLUMN)
    assert found.share == 1.0
    assert np.isnan([found.low, found.high]).all()


def test_independent_reversals_have_about_the_binomial_interval() -> None:
    found = vanished_share(frame([1] * 60 + [0] * 140, [1] * 200), COLUMN)
    exact = scipy.stats.binomtest(60, 200).proportion_ci(0.95, "wilson")
    assert (found.low, found.high) == pytest.approx((exact.low, exact.high), abs=0.015)


def test_bursts_widen_the_interval() -> None:
    alone = vanished_share(frame([1] * 60 + [0] * 140, [1] * 200), COLUMN)
    bursts = vanished_share(frame([10] * 6 + [0] * 14, [10] * 20), COLUMN)
    assert bursts.share == alone.share
    assert bursts.high - bursts.low > 2 * (alone.high - alone.low)


def test_the_stages_of_an_episode_are_drawn_together() -> None:
    stages = pd.concat([frame([1] * 20, [1] * 20), frame([0] * 20, [1] * 20).assign(stage=3)])
    found = vanished_share(stages, COLUMN)
    assert (found.share, found.low, found.high) == (0.5, 0.5, 0.5)
