"""Scalar arithmetic of one world, compiled to broadcast over batches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from filelock import FileLock
from numba.core.caching import FunctionCache


def broadcast(types: str, layout: str) -> Callable[[Callable[..., None]], Any]:
    """A decorator that makes a generalized ufunc of a function that fills its last argument in place.

    `types` are numba's, comma-separated, `layout` is the gufunc signature, e.g. "f8[:], i8[:]" and "(n)->()".
    Tasks are judged at every control step: for one world the compiled call costs 3 microseconds where a dozen
    numpy calls cost 30, and far more once physics has emptied the caches. Compiled once per machine, cached on disk.
    """

    def build(function: Callable[..., None]) -> Any:
        folder = Path(FunctionCache(function).cache_path)  # type: ignore[no-untyped-call]
        folder.mkdir(parents=True, exist_ok=True)
        # numba caches a gufunc as two files that name each other. Written by two processes at once they may come
        # from different ones, and every later call ends in a segmentation fault.
        with FileLock(folder / "compile.lock"):
            return numba.guvectorize([f"void({types})"], layout, nopython=True, cache=True)(function)  # type: ignore[no-untyped-call]

    return build


def scalar(function: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator for a helper that `broadcast` functions of the same file call."""
    return numba.njit(cache=True)(function)
