"""What is found on each simulator, against the oracle.

python studies/discovery_seeds/analysis.py runs/discovery_seeds-quick
"""

import sys
from pathlib import Path

from causalbench.report.edge_scores import edge_scores, read_edges

edges = read_edges(Path(sys.argv[1]))
found = edges[edges["selected"] == 1].groupby(["stage", "term", "action", "backend"])["seed"].nunique().unstack()
print(found.fillna(0).astype(int).to_string(), end="\n\n")
print(edge_scores(edges, ["backend"]).to_string())
