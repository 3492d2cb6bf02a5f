"""What studies read of a run is what a run writes."""

from __future__ import annotations

from pathlib import Path

from causalbench.report.edge_scores import edge_scores, read_edges


def test_the_edges_of_a_run_can_be_read_and_scored(finished_run: Path) -> None:
    edges = read_edges(finished_run)
    assert edges["grid_point"].notna().all()
    assert len(edge_scores(edges.assign(oracle_grade="absent"), ["backend", "grid_point"])) > 0
