"""Worlds whose causal graph is planted: what a method of discovery is examined on."""
