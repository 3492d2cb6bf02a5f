"""Bullet's Python module `pb`, imported without the line that it writes to the standard error stream."""

from __future__ import annotations

import os
import sys


def _quietly() -> None:
    """Import pybullet with file descriptor 2 turned away: the line is written by C code."""
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # there is no such stream
        import pybullet  # noqa: F401

        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        import pybullet  # noqa: F401
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)


_quietly()

import pybullet as pb  # noqa: E402

__all__ = ["pb"]
