"""Proximal policy optimisation with the causal policy gradient."""
