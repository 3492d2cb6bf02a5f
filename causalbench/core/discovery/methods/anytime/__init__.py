"""Our own discoverer: an e-value for every edge, until each is decided or the steps are spent."""
