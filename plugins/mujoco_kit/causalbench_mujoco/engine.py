"""MuJoCo, imported without the window system that it would load with its first import."""

from __future__ import annotations

import os

from causalbench.backend import variable_by_default

try:
    with variable_by_default("MUJOCO_GL", "disable"):
        import mujoco
except AttributeError as error:  # PyOpenGL says that it found no such library by an attribute of None
    raise ImportError(
        f"MUJOCO_GL={os.environ.get('MUJOCO_GL')}: its library is not on this machine ({error}). "
        "Unset MUJOCO_GL, or install it (Debian: apt-get install libosmesa6)"
    ) from error

__all__ = ["mujoco"]
