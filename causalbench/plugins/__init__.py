"""Plugins: the hooks, what causalbench registers itself, and the manager that finds all others."""
