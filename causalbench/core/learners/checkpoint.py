"""Checkpoints: one safetensors file, whose header also holds JSON. Loading one runs no code.

A file is written under another name, synced and moved, so that a kill at any instant leaves the old one or the new. Its
header has the SHA-256 of all that is in it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from torch import Tensor

from causalbench import formats
from causalbench.atomic import replacing
from causalbench.core.networks.state import State
from causalbench.digests import arrays_digest
from causalbench.errors import CheckpointError

REMEDY = "delete it to train from the start, or continue with what it was made with"


@dataclass(frozen=True)
class Checkpoints:
    """Where and how often to keep the state of a training run. Neither changes its results.

    A run that sees `stop_asked()` after a step keeps its state at once and raises `StoppedError`.
    """

    path: Path
    every: int = 2_000  # env steps
    stop_asked: Callable[[], bool] = lambda: False


def save_checkpoint(path: Path, state: State, identity: Mapping[str, Any]) -> None:
    """Replace `path` by `state`, as a whole or not at all. `identity` is JSON data that a continuation must share."""
    arrays: dict[str, Any] = {}
    values: dict[str, Any] = {}
    for name, value in state.items():
        if isinstance(value, Tensor | np.ndarray):
            arrays[name] = np.asarray(value.cpu() if isinstance(value, Tensor) else value, order="C")
        else:
            values[name] = value
    # As a reader gets it: a tuple is a list, a number as a key is text.
    header = json.loads(
        json.dumps({"schema": formats.CHECKPOINT, "identity": identity, "values": values}, allow_nan=False)
    )
    header["sha256"] = arrays_digest(header, arrays)
    with replacing(path) as temporary:
        save_file(arrays, temporary, {"causalbench": json.dumps(header)})


def load_checkpoint(path: Path, identity: Mapping[str, Any]) -> State | None:
    """The state in `path`, arrays as tensors; None if there is no such file.

    Raises `CheckpointError` unless the file is what was written, of this version, and made with the same `identity`.
    """
    if not path.exists():
        return None
    try:
        header, arrays = _read(path)
    except (SafetensorError, OSError, KeyError, ValueError, TypeError) as error:
        raise CheckpointError(f"{path}: not a checkpoint of causalbench, or damaged ({error!r}); {REMEDY}") from error
    if difference := _difference(header["identity"], json.loads(json.dumps(identity))):
        raise CheckpointError(f"{path}: a checkpoint of another run, {difference}; {REMEDY}")
    return {name: torch.from_numpy(array) for name, array in arrays.items()} | header["values"]


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays. Raises `ValueError` unless they are those that were written by this version."""
    with safe_open(path, framework="np") as file:
        header = json.loads((file.metadata() or {})["causalbench"])
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
    if header["schema"] != formats.CHECKPOINT:
        raise ValueError(f"schema {header['schema']}, expected {formats.CHECKPOINT}")
    if header.pop("sha256") != arrays_digest(header, arrays):
        raise ValueError("its SHA-256 is not that of what was written")
    return header, arrays


def _difference(made_with: Any, given: Any, name: str = "") -> str:
    """The first difference of two JSON values in words; "" if there is none."""
    if isinstance(made_with, dict) and isinstance(given, dict):
        parts = (_difference(made_with.get(k), given.get(k), f"{name} {k}") for k in {**made_with, **given})
        return next(filter(None, parts), "")
    return "" if made_with == given else f"whose{name} is {made_with!r}, not {given!r}"
