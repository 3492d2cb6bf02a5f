"""Stands for a simulator: what a plugin must not import when it is imported itself."""
