"""What the paper's preset finds beside the default, against the oracle.

python studies/discovery_paper/analysis.py runs/discovery_paper-quick
"""

import sys
from pathlib import Path

from causalbench.report.edge_scores import edge_scores, read_edges

edges = read_edges(Path(sys.argv[1]))
print(edge_scores(edges, ["backend", "grid_point"]).to_string())
