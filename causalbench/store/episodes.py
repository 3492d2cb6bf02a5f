"""`episodes.csv` of a learner cell: every episode of its final evaluation, with its stage trace.

A trace is text in run-length form: "1x12 2x5 1x3" took 12 steps in stage 1, then 5 in stage 2, then 3 in stage 1. The
stage after the last step is the column `final_stage`, n_stages + 1 on success.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from causalbench.core.learners.records import Episode
from causalbench.store.records import RETURN, reading, table_rows, write_rows

COLUMNS = (
    "episode", "deterministic", "success", "held", "n_stages", "length", "reversals", "final_stage", "stages",
    "return",
)  # fmt: skip
"""The columns of every task; one for the return of each reward term follows."""
LONGEST = 1_000_000
"""Steps that a stage trace has at most: a file from a stranger must not fill the memory."""
RUN = re.compile(r"([1-9][0-9]*)x([1-9][0-9]*)")


def run_lengths(stages: Sequence[int]) -> str:
    """A stage trace as text."""
    return " ".join(f"{stage}x{len([*steps])}" for stage, steps in groupby(stages))


def stage_trace(text: str) -> tuple[int, ...]:
    """The stage of every step, which `run_lengths` made a text of. Raises `ValueError` for any other text."""
    runs = [(int(run[1]), int(run[2])) for run in map(RUN.fullmatch, text.split(" ")) if run]
    if len(runs) != text.count(" ") + 1:
        raise ValueError(f"{text!r} is no stage trace such as '1x12 2x5'")
    if sum(length for _, length in runs) > LONGEST:
        raise ValueError(f"a stage trace of more than {LONGEST} steps")
    return tuple(stage for stage, length in runs for _ in range(length))


def episode_row(episode: Episode) -> dict[str, Any]:
    """The row of an episode; booleans are 1 and 0."""
    row = {name: getattr(episode, name) for name in COLUMNS if name not in ("stages", "return")}
    numbers = {name: int(value) if isinstance(value, bool) else value for name, value in row.items()}
    own = {"stages": run_lengths(episode.stages), "return": sum(episode.returns.values())}
    return numbers | own | {RETURN + term: value for term, value in episode.returns.items()}


def return_columns(episodes: Sequence[Episode]) -> tuple[str, ...]:
    """The columns of a table of these episodes that follow `COLUMNS`."""
    terms = dict.fromkeys(term for episode in episodes for term in episode.returns)
    return tuple(RETURN + term for term in terms)


def write_episodes(path: Path, episodes: Sequence[Episode]) -> None:
    """Replace `episodes.csv`; a learner that keeps no episodes has a table without rows."""
    write_rows(path, (*COLUMNS, *return_columns(episodes)), map(episode_row, episodes))


def read_episodes(path: Path) -> list[Episode]:
    """What `write_episodes` wrote; floats come back bit for bit. Raises `DamagedFileError` for anything else."""
    with reading(path):
        return [_episode(row) for row in table_rows(path, COLUMNS)]


def _episode(row: dict[str, str]) -> Episode:
    return Episode(
        episode=int(row["episode"]),
        deterministic=row["deterministic"] == "1",
        success=row["success"] == "1",
        held=row["held"] == "1" if row["held"] else None,
        n_stages=int(row["n_stages"]),
        stages=stage_trace(row["stages"]),
        final_stage=int(row["final_stage"]),
        returns={name.removeprefix(RETURN): float(value) for name, value in row.items() if name.startswith(RETURN)},
    )
