"""Causal discovery (paper, Algorithms 1 and 2), one step a module."""
