"""Success by step, seed by seed: `python studies/features/analysis.py runs/features-quick`."""

import sys
from pathlib import Path

from causalbench import load_results

found = load_results(Path(sys.argv[1]))
curves = found.curves.pivot_table(
    index=["method", "grid_point", "seed"], columns="env_steps", values="success_deterministic"
)
columns = ["steps_to_90", "stopped_at", "success_deterministic", "success_sampled", "reversals_per_1000_steps"]
print(curves.to_string(), end="\n\n")
print(found.results.set_index(["method", "grid_point", "seed"])[columns].to_string())
