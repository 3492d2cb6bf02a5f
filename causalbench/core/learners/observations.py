"""The border of `StagedPolicy.predict`: an observation is what the policy reads, or it is refused by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.errors import InvalidObservationError

STATE, STAGE, GRIPPER = "state", "stage", "gripper"


def checked_observation(
    observation: object, sizes: Mapping[str, int], n_inputs: int, n_stages: int
) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64], bool]:
    """What `predict` was given, in batches: entries (n, ...), stages (n,) from 0, and whether it was one observation.

    `sizes` says how many numbers each entry beside `state`, `gripper` and `stage` has; state and gripper together have
    `n_inputs`. Numbers of other types become float32, as those of environments are. Raises `InvalidObservationError`.
    """
    if not isinstance(observation, Mapping):
        raise InvalidObservationError(f"observation: expected a dictionary, got {type(observation).__name__}")
    if missing := [name for name in (STATE, STAGE, *sizes) if name not in observation]:
        raise InvalidObservationError(f"this policy reads {missing}, and the observation has {sorted(observation)}")
    state = _numbers(STATE, observation[STATE])
    single = state.ndim < 2
    with_gripper = state.shape[-1:] == (n_inputs - 1,) and GRIPPER in observation
    read = {STATE: n_inputs - with_gripper} | ({GRIPPER: 1} if with_gripper else {}) | dict(sizes)
    n = 1 if single else len(state)
    batched = {name: _batched(name, observation[name], n, size, single) for name, size in read.items()}
    return batched, _stages(observation[STAGE], n, n_stages), single


def _numbers(name: str, value: object) -> NDArray[Any]:
    """`value` as an array of finite numbers; what is not uint8 as float32."""
    try:
        array = np.asarray(value)
        if array.dtype != np.uint8:
            array = array.astype(np.float32, casting="same_kind", copy=False)
    except (TypeError, ValueError) as error:
        raise InvalidObservationError(f"observation[{name!r}] is no array of numbers: {error}") from error
    if array.dtype != np.uint8 and not np.isfinite(array).all():
        raise InvalidObservationError(f"observation[{name!r}] is not finite")
    return array


def _batched(name: str, value: object, n: int, size: int, single: bool) -> NDArray[Any]:
    """The entry `name` of `n` observations with `size` numbers each, in a batch."""
    array = _numbers(name, value)
    shape = array.shape if single else array.shape[1:]
    if int(np.prod(shape)) != size or not shape or not (single or len(array) == n):
        expected = f"{size} numbers" if single else f"{n} rows of {size} numbers"
        raise InvalidObservationError(f"observation[{name!r}] has shape {array.shape}, expected {expected}")
    return array[None] if single else array


def _stages(value: object, n: int, n_stages: int) -> NDArray[np.int64]:
    stages = np.asarray(value)
    if stages.dtype.kind not in "iu" or stages.size != n or stages.ndim > 1:
        raise InvalidObservationError(f"observation[{STAGE!r}] is {value!r}, expected {n} whole numbers")
    if not ((stages >= 0) & (stages < n_stages)).all():
        raise InvalidObservationError(f"observation[{STAGE!r}] is {value!r}, expected 0 to {n_stages - 1}")
    return stages.reshape(-1).astype(np.int64, copy=False)
