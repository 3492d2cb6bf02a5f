"""Per-stage learners; the paper's methods are rows of the table in `methods`."""
