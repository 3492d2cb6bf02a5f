"""How right `anytime` is, of a run of this suite: `python studies/discovery_anytime/analysis.py RUNFOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

from causalbench.report.edge_scores import edge_scores, read_edges


def main() -> None:
    """Print scores on strong and absent edges by backend, and how many edges were left undecided."""
    edges = read_edges(Path(sys.argv[1]))
    scores = edge_scores(edges, ["backend", "seed"])
    left = edges.assign(undecided=edges["outcome"] == "undecided").groupby(["backend", "seed"])["undecided"].sum()
    print(scores.join(left)[["f1", "missed", "false", "undecided"]].round(3).to_string())


if __name__ == "__main__":
    main()
