"""A discovered graph judged by the oracle, and the files that say so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from causalbench.atomic import write_text
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.tasks.stage_task import StageTask

if TYPE_CHECKING:
    from causalbench.core.discovery.truth.oracle import StageTruth
    from causalbench.core.staged.worlds import MakeWorlds


def judge_graph(
    graph: CausalGraph,
    task: StageTask,
    make_worlds: MakeWorlds,
    states: int,
    seed: int,
    folder: Path,
    on_progress: Callable[[float, str], None],
) -> tuple[CausalGraph, tuple[StageTruth, ...]]:
    """The graph with its score, and the truth from `states` visited states a stage; writes oracle.csv and score.csv.

    The truth is about actions held as long as those of the discovery.
    """
    from causalbench.core.discovery.tables import oracle_table, score_table
    from causalbench.core.discovery.truth.oracle import consult_oracle
    from causalbench.core.discovery.truth.score import with_score

    action_repeat = graph.provenance["settings"]["action_repeat"]
    truth = consult_oracle(task, make_worlds, states, seed, on_progress, action_repeat)
    for name, table in (("oracle.csv", oracle_table(graph, truth)), ("score.csv", score_table(graph, truth))):
        write_text(folder / name, table.to_csv(index=False, lineterminator="\n"))
    return with_score(graph, truth), truth
