"""Building blocks for authors of backends; simulator-free."""
