"""What is true: counterfactuals from snapshots, the oracle, and scores against it."""
