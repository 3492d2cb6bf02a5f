"""Scalar arithmetic of one world, compiled to broadcast over batches."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from causalbench.core.numerics.compiled import cache_folder, cached, can_compile

DTYPES = {"f4": np.float32, "f8": np.float64, "i8": np.int64, "b1": np.bool_}


def broadcast(types: str, layout: str) -> Callable[[Callable[..., None]], Any]:
    """A decorator that makes a generalized ufunc of a function that fills its last argument in place.

    `types` are numba's, comma-separated, `layout` is the gufunc signature, e.g. "f8[:], i8[:]" and "(n)->()".
    Tasks are judged at every control step: for one world the compiled call costs 3 microseconds where a dozen
    numpy calls cost 30, and far more once physics has emptied the caches.
    """

    def decorate(function: Callable[..., None]) -> Any:
        if not can_compile(function):
            return interpreted(function, types, layout)
        import numba

        build = cached(numba.guvectorize, [f"void({types})"], layout, nopython=True)
        folder = cache_folder(function)
        if not folder:
            return build(function)
        Path(folder).mkdir(parents=True, exist_ok=True)
        # numba caches a gufunc as two files that name each other. Written by two processes at once they may come
        # from different ones, and every later call ends in a segmentation fault.
        with FileLock(Path(folder, "compile.lock")):
            return build(function)

    return decorate


def interpreted(function: Callable[..., None], types: str, layout: str) -> Callable[..., Any]:
    """What `broadcast` makes of `function`, without a compiler: a loop over the batch."""
    dtypes = [DTYPES[name] for name in re.findall(r"\w\d", types)]
    *inputs, output = [[name for name in dims.split(",") if name] for dims in re.findall(r"\(([^)]*)\)", layout)]

    def call(*arguments: Any) -> Any:
        arrays = [np.asarray(argument, dtype) for argument, dtype in zip(arguments, dtypes[:-1], strict=True)]
        cuts = [array.ndim - len(dims) for array, dims in zip(arrays, inputs, strict=True)]
        batch = np.broadcast_shapes(*(array.shape[:cut] for array, cut in zip(arrays, cuts, strict=True)))
        whole = [np.broadcast_to(a, batch + a.shape[cut:]) for a, cut in zip(arrays, cuts, strict=True)]
        sizes: dict[str, int] = {}
        for array, cut, dims in zip(arrays, cuts, inputs, strict=True):
            sizes |= zip(dims, array.shape[cut:], strict=True)
        core = tuple(sizes[name] for name in output)
        out = np.empty(batch + (core or (1,)), dtypes[-1])
        for index in np.ndindex(batch):
            function(*(array[index] for array in whole), out[index])
        return out.reshape(batch + core)[()]

    return call
