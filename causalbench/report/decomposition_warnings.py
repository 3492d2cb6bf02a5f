"""What a run's data alone say against the decomposition of its tasks: sentences, none where nothing does."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

PLACE = ["task", "backend"]


def decomposition_warnings(edges: pd.DataFrame, account: pd.DataFrame, episodes: pd.DataFrame) -> list[str]:
    """Sentences from rows of `discovery.csv`, `stage_account.csv` and `episodes.csv`; any of them may be empty."""
    return [*_causes(edges), *_skipped(account), *_farming(episodes)]


def _causes(edges: pd.DataFrame) -> Iterator[str]:
    """Terms that never varied, and terms that no action causes, by the oracle of every discovery that asked one."""
    asked = edges[edges["oracle_grade"].notna() & (edges["oracle_grade"] != "")]
    for (task, backend, stage, term), rows in asked.groupby([*PLACE, "stage", "term"]):
        grades = {*rows["oracle_grade"]}
        if grades == {"absent"}:
            yield f"{task} on {backend}: no action causes {term} in stage {stage}, which varies all the same."
        elif grades == {"untestable"}:
            yield f"{task} on {backend}: {term} never varied in stage {stage}, so that it has no causes there."


def _skipped(account: pd.DataFrame) -> Iterator[str]:
    """Stages that no episode spent a step in, though some got beyond them."""
    for (task, backend), rows in account.groupby(PLACE):
        counts = rows.groupby("stage")[["steps_in_stage", "episodes_reached"]].sum().iloc[:-1]  # but for success
        for stage in counts.index[(counts["steps_in_stage"] == 0) & (counts["episodes_reached"] > 0)]:
            yield f"{task} on {backend}: episodes got beyond stage {stage}, and none spent a step in it."


def _farming(episodes: pd.DataFrame) -> Iterator[str]:
    """Failures that earn more of the sum of the terms than a success does."""
    for (task, backend), rows in episodes.groupby(PLACE):
        won, lost = (rows.loc[rows["success"] == flag, "return"] for flag in (1, 0))
        if len(won) and len(lost) and (more := int((lost > won.median()).sum())):
            yield (
                f"{task} on {backend}: {more} of {len(lost)} episodes that failed earned more than a success does "
                f"({lost.max():.1f} at most, {won.median():.1f}): the sum of the terms can be farmed."
            )
