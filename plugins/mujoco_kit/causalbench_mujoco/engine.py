"""MuJoCo, imported without the window system that it would load with its first import."""

from __future__ import annotations

from causalbench.backend import variable_by_default

with variable_by_default("MUJOCO_GL", "disable"):
    import mujoco

__all__ = ["mujoco"]
