"""Whether backends rank methods alike."""

from __future__ import annotations

import pytest
import scipy.stats

from causalbench.report.agreement import agreement


def test_agreement_is_kendalls_of_methods_that_are_ranked_on_both() -> None:
    x, y = [0.1, 0.5, 0.3, 0.9], [0.2, 0.4, 0.6, 0.8]
    board = [
        {"backend": backend, "method": method, "grid_point": "", "rank": 1, "success_auc_iqm": area}
        for backend, areas in (("x", x), ("y", y), ("all", x))
        for method, area in zip("ABCD", areas, strict=True)
    ]
    (row,) = agreement([*board, {"backend": "y", "method": "E", "grid_point": "", "success_auc_iqm": 0.0}])
    expected = scipy.stats.kendalltau(x, y)
    assert (row["backend"], row["other_backend"], row["methods"]) == ("x", "y", 4)
    assert row["kendall_tau"] == pytest.approx(4 / 6) == pytest.approx(expected.statistic)
    assert row["p_value"] == pytest.approx(expected.pvalue)
    assert agreement([row | {"rank": 1, "success_auc_iqm": 0.0, "method": "A", "grid_point": ""}]) == []
