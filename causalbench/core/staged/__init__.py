"""Staged worlds: a task in a simulator, stepped and judged."""
