"""How reward models are trained, for every discoverer that fits them; imports no torch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Ge, Gt


@dataclass(frozen=True)
class RewardModelSettings:
    """Optimisation of the reward models, to inherit from. `PAPER` and `PAPER_LARGE` hold the paper's values."""

    batch_size: Annotated[int, Gt(0)] = 256  # samples in a gradient step
    learning_rate: Annotated[float, Gt(0)] = 2e-3  # of Adam
    max_epochs: Annotated[int, Gt(0)] = 40  # most passes over the samples
    patience: Annotated[int, Ge(0)] = 3  # epochs without a better held-out likelihood until it stops; 0: never early
    sigma_train: Annotated[float, Gt(0)] = 0.01  # least sigma while training, in deviations of the term


PAPER: dict[str, Any] = {"batch_size": 32, "learning_rate": 5e-4, "max_epochs": 100, "patience": 0}
"""Appendix, hyperparameter setting, pure manipulation."""
PAPER_LARGE: dict[str, Any] = PAPER | {"max_epochs": 500}
"""The same for mobile manipulation."""
