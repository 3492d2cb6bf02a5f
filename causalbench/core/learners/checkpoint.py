"""Checkpoints: one safetensors file, whose header also holds JSON. Loading one runs no code.

A file is written under another name, synced and moved, so that a kill at any instant leaves the old one or the new.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from torch import Tensor

from causalbench.core.networks.state import State
from causalbench.errors import CheckpointError

SCHEMA = 2


@dataclass(frozen=True)
class Checkpoints:
    """Where and how often to keep the state of a training run. Neither changes its results."""

    path: Path
    every: int = 2_000  # env steps


def save_checkpoint(path: Path, state: State, identity: Mapping[str, Any]) -> None:
    """Replace `path` by `state`, as a whole or not at all. `identity` is JSON data that a continuation must share."""
    arrays: dict[str, Any] = {}
    values: dict[str, Any] = {}
    for name, value in state.items():
        if isinstance(value, Tensor | np.ndarray):
            arrays[name] = np.asarray(value.cpu() if isinstance(value, Tensor) else value, order="C")
        else:
            values[name] = value
    header = {"schema": SCHEMA, "identity": identity, "values": values}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    save_file(arrays, temporary, {"causalbench": json.dumps(header, allow_nan=False)})
    with temporary.open("rb+") as file:
        os.fsync(file.fileno())
    os.replace(temporary, path)


def load_checkpoint(path: Path, identity: Mapping[str, Any]) -> State | None:
    """The state in `path`, arrays as tensors; None if there is no such file.

    Raises `CheckpointError` unless the file is whole, of this version, and made with the same `identity`.
    """
    if not path.exists():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {})["causalbench"])
            state: State = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
    except (SafetensorError, OSError, KeyError, ValueError) as error:
        raise CheckpointError(f"{path}: not a checkpoint of causalbench, or damaged ({error!r}); {REMEDY}") from error
    if header["schema"] != SCHEMA:
        raise CheckpointError(f"{path}: checkpoint schema {header['schema']}, expected {SCHEMA}; {REMEDY}")
    if difference := _difference(header["identity"], json.loads(json.dumps(identity))):
        raise CheckpointError(f"{path}: a checkpoint of another run, {difference}; {REMEDY}")
    return state | header["values"]


REMEDY = "delete it to train from the start, or continue with what it was made with"


def _difference(made_with: Any, given: Any, name: str = "") -> str:
    """The first difference of two JSON values in words; "" if there is none."""
    if isinstance(made_with, dict) and isinstance(given, dict):
        parts = (_difference(made_with.get(k), given.get(k), f"{name} {k}") for k in {**made_with, **given})
        return next(filter(None, parts), "")
    return "" if made_with == given else f"whose{name} is {made_with!r}, not {given!r}"
