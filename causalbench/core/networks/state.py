"""State of networks and optimisers as flat mappings of names to tensors and plain values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

State = dict[str, Any]
"""All that a continuation needs, flat: tensors, and values that JSON keeps exactly (numbers, texts, lists, dicts)."""


def prefixed(prefix: str, state: Mapping[str, Any]) -> State:
    """`state` with `prefix.` before each name."""
    return {f"{prefix}.{name}": value for name, value in state.items()}


def below(prefix: str, state: Mapping[str, Any]) -> State:
    """What `prefixed(prefix, ...)` put into `state`."""
    start = f"{prefix}."
    return {name.removeprefix(start): value for name, value in state.items() if name.startswith(start)}


def tensor_state(tensors: list[Tensor]) -> State:
    """Weights by their index."""
    return {str(k): tensor.detach() for k, tensor in enumerate(tensors)}


def load_tensors(tensors: list[Tensor], state: State) -> None:
    """Overwrite `tensors` in place: others hold references to them."""
    with torch.no_grad():
        for k, tensor in enumerate(tensors):
            tensor.copy_(state[str(k)])


def optimizer_state(optimizer: torch.optim.Optimizer) -> State:
    """The moments and step counts of every weight; empty before the first step."""
    moments = optimizer.state_dict()["state"]
    return {f"{k}.{name}": value for k, values in moments.items() for name, value in values.items()}


def load_optimizer(optimizer: torch.optim.Optimizer, state: State) -> None:
    """What `optimizer_state` gave; hyperparameters stay the optimiser's own."""
    moments: dict[int, dict[str, Any]] = {}
    for name, value in state.items():
        k, _, moment = name.partition(".")
        moments.setdefault(int(k), {})[moment] = value
    optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
