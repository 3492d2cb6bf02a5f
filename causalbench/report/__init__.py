"""What a run folder says: tables and statistics, read from the store alone (no torch, no simulator)."""
