"""What callers of `reset` ask for, honoured or refused by name, for one world and for several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import UserError

STAGE, MASK = "stage", "reset_mask"


def checked_seed(seed: object) -> int | None:
    """`seed` as Python's int, or None. Raises `UserError` for all but whole numbers from 0."""
    if seed is None:
        return None
    if isinstance(seed, bool | np.bool_) or not isinstance(seed, int | np.integer) or seed < 0:
        raise UserError(f"seed {seed!r}: expected a whole number from 0, or None")
    return int(seed)


def checked_seeds(seed: object, n: int) -> list[Any]:
    """What seeds the generator of each of `n` worlds; None leaves it as it is.

    A list has a seed for each world, as in Gymnasium's own vector environments; one number is the first part of each
    world's. Raises `UserError`.
    """
    if isinstance(seed, list | tuple):
        if len(seed) != n:
            raise UserError(f"seed: a list of {len(seed)}, expected one for each of {n} worlds")
        return [checked_seed(one) for one in seed]
    number = checked_seed(seed)
    return [None if number is None else [number, i] for i in range(n)]


def checked_options(options: object, known: Sequence[str]) -> Mapping[str, Any]:
    """`options` of a reset, none for None. Raises `UserError` for a key that is not among the `known` ones."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise UserError(f"options: expected a mapping, got {type(options).__name__}")
    if unknown := [key for key in options if key not in known]:
        raise UserError(f"options: unknown key {unknown[0]!r}; known: {', '.join(known)}")
    return options


def checked_stage(options: Mapping[str, Any], task: StageTask) -> int | None:
    """The stage, from 1, that a start shall lie in, None for any. Raises `UserError`."""
    stage = options.get(STAGE)
    if stage is None:
        return None
    if isinstance(stage, bool) or not isinstance(stage, int | np.integer) or not 1 <= stage <= task.n_stages:
        raise UserError(f"options: stage {stage!r} is not one of 1 to {task.n_stages} of {task.name}")
    return int(stage)


def checked_mask(options: Mapping[str, Any], n: int) -> NDArray[np.int64]:
    """The worlds that shall be reset: those of the mask, or all `n`. Raises `UserError`."""
    mask = options.get(MASK)
    if mask is None:
        return np.arange(n)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (n,) or not mask.any():
        raise UserError(f"options: {MASK}: expected a bool array ({n},) with at least one True, got {mask!r}")
    return np.flatnonzero(mask)
