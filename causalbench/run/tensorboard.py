"""TensorBoard files of a cell, on request: `causalbench run --tensorboard`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from causalbench.core.learners.records import Evaluation
from causalbench.errors import UserError

CURVES = (
    "success_deterministic", "success_sampled", "held_rate", "mean_final_stage", "mean_length", "reversals_per_episode",
)  # fmt: skip


def summary_writer() -> Any:
    """torch's `SummaryWriter`. Raises `UserError` where the package tensorboard is not installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise UserError(
            "--tensorboard needs a package that is not installed: pip install 'causalbench-robotics[tensorboard]'"
        ) from error
    return SummaryWriter


class Board:
    """Writes the evaluations of one training run into `folder`."""

    def __init__(self, folder: Path) -> None:
        self._writer = summary_writer()(str(folder))

    def add(self, evaluation: Evaluation) -> None:
        """Add a point to every curve, at the evaluation's env step."""
        points = {f"evaluation/{name}": getattr(evaluation, name) for name in CURVES}
        points |= {f"return/{term}": value for term, value in evaluation.term_returns.items()}
        for name, value in points.items():
            if value is not None:
                self._writer.add_scalar(name, value, evaluation.env_steps)
        self._writer.flush()

    def close(self) -> None:
        """End the files."""
        self._writer.close()
