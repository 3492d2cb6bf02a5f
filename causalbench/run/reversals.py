"""Whose doing the reversals of finished policies are, on the starts that evaluations use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.learners.records import ReversalCauses
from causalbench.core.learners.reversal_causes import Mask, reversal_causes
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.world.capabilities import Capability, lacking
from causalbench.plugins.manager import installed
from causalbench.run.policies import Trained, finished, trained
from causalbench.store.beside import REVERSALS, write_beside
from causalbench.store.cells import StoredCell
from causalbench.store.run_folder import RunFolder


def account_for_reversals(run: RunFolder, only: Sequence[str], episodes: int) -> Iterator[str]:
    """Write `reversals.csv` beside the results of every finished policy that `only` keeps; a sentence for each.

    Each policy plays `episodes` deterministic and as many sampled episodes. Raises `UserError` when there is no policy.
    """
    cells = run.cells()
    for cell in finished(run, only):
        title = f"{cell.method} on {cell.backend}, seed {cell.seed}"
        ready = trained(cell)
        with ready.env() as env:
            if Capability.EXACT_RESTORE not in env.worlds.capabilities:
                yield f"{title}: left out; {lacking(Capability.EXACT_RESTORE, 'this', cell.backend, cell.task)}"
                continue
            graph = graph_for(cell, cells)
            found = _rows(ready, env, _causes(graph, env.action_names), episodes)
            rows = [replace(row, causes_graph=graph.hash) for row in found]
        write_beside(cell.folder, REVERSALS, rows)
        yield f"{title}: {_summary(rows)}"


def graph_for(cell: StoredCell, cells: Sequence[StoredCell]) -> CausalGraph:
    """The graph whose causes are meant: what the run discovered where `cell` was trained, else the human's.

    Of several discoveries it is the one that the cell learned with; else one by the suite's discoverer before one that
    a method names for itself, and one of the cell's own seed before that of the lowest seed.
    """
    found = [other for other in cells if other.is_done("discovery") and _place(other) == _place(cell)]
    if not found:
        return manual_graph(installed().task(cell.task))
    named = {other.identity["discovery"] for other in cells if other.identity.get("method", {}).get("discoverer")}
    own = cell.identity.get("discovery")
    return min(
        found,
        key=lambda other: (other.id != own, other.id in named, other.seed != cell.seed, other.seed, other.id),
    ).graph()


def _place(cell: StoredCell) -> tuple[object, object]:
    return cell.identity["task"], cell.identity["backend"]


def _causes(graph: CausalGraph, actions: Sequence[str]) -> Mask:
    """(n_stages, n_actions): which actions a policy on the graph sets in which stage."""
    return np.array([[name in stage.policy_actions() for name in actions] for stage in graph.stages])


def _rows(ready: Trained, env: StageTaskEnv, causes: Mask, episodes: int) -> Iterator[ReversalCauses]:
    for deterministic in (True, False):
        for episode in range(episodes):
            seed = ready.first_start + episode
            yield from reversal_causes(ready.policy, env, causes, episode, seed, deterministic)


def _summary(rows: Sequence[ReversalCauses]) -> str:
    reversals, redundant, causes = (
        sum(getattr(row, name) for row in rows)
        for name in ("reversals", "vanished_without_redundant", "vanished_without_causes")
    )
    if not reversals:
        return "no reversal"
    return f"of {reversals} reversals {redundant} vanish without redundant actions, {causes} without the causes"
