"""How far the graph of the unchanged scene carries: `python studies/variants/analysis.py runs/variants_graphs-quick`.

A row per backend, point of the grid and seed of a run: F1, missed and false edges of the scene's own graph and of that
of the unchanged scene, both among the edges that the scene's own oracle calls strong or absent.
"""

import sys
from pathlib import Path

import pandas as pd

from causalbench.report.edge_scores import edge_scores, read_edges

BASE = "pure_manipulation"
EDGE = ["backend", "seed", "stage", "term", "action"]
ROW = ["backend", "grid_point", "seed"]
SCORES = ["f1", "missed", "false"]


def carried(edges: pd.DataFrame) -> pd.DataFrame:
    """Scores of each scene's own graph, `..._own`, and of the unchanged scene's, `..._carried`; index `ROW`.

    What the unchanged scene does not have, such as distractors, its graph does not select.
    """
    unchanged = edges[edges["task"] == BASE].set_index(EDGE)["selected"]
    selected = unchanged.reindex(pd.MultiIndex.from_frame(edges[EDGE])).fillna(0).astype(int).to_numpy()
    own, other = (edge_scores(table, ROW)[SCORES] for table in (edges, edges.assign(selected=selected)))
    return own.add_suffix("_own").join(other.add_suffix("_carried"))


if __name__ == "__main__":
    print(carried(read_edges(Path(sys.argv[1]))).round(2).to_string())
