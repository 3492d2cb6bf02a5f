"""Methods of causal discovery, one file each."""
