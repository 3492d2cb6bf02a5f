"""Running a plan: one cell, many cells, and what is shown meanwhile."""
