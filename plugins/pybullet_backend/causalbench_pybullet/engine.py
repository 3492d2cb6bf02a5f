"""Bullet's Python module `pb`, imported without the line that its C code writes to the standard error stream."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """File descriptor 2 leads nowhere meanwhile."""
    kept, sink = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)


with _silence():
    import pybullet as pb

__all__ = ["pb"]
