"""Soft actor-critic with the causal policy gradient."""
