"""Robots as the tasks use them: what must be equal in every simulator that simulates one."""
