"""A run folder that is asked for a larger budget than it holds: what its cells go on from, in place of the start."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from causalbench.digests import content_hash
from causalbench.plugins.manager import installed
from causalbench.run.cell import source_of
from causalbench.store.budgets import but_budget, is_outgrown, largest_budgets
from causalbench.store.cells import CHECKPOINT, StoredCell
from causalbench.store.files import is_file
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, LearnerCell


def amend(cells: Sequence[Cell], run: RunFolder) -> Iterator[str]:
    """Give those of `cells` that lie in `run` with a smaller budget the checkpoint of that one to go on from.

    Says in sentences what goes on, what starts over and why. A cell with a checkpoint of its own stays as it is.
    """
    largest = largest_budgets(cell.identity for cell in cells)
    outgrown = [cell for cell in run.every_cell() if is_outgrown(cell.identity, largest)]
    if not outgrown:
        return
    yield f"{len(outgrown)} cells of a smaller budget stay in {run.path}, but in none of its tables"
    shorter = _by_all_but_budget(outgrown)
    larger = [(cell, shorter.get(_key(cell))) for cell in cells if isinstance(cell, LearnerCell)]
    reasons = [(cell.id, _go_on(cell, found, run)) for cell, found in larger if found]
    if goes_on := sum(not reason for _, reason in reasons):
        yield f"{goes_on} cells go on from where their smaller budget ended"
    yield from (f"{name} starts over: {reason}" for name, reason in reasons if reason)


def _go_on(cell: LearnerCell, shorter: StoredCell, run: RunFolder) -> str:
    """Let `cell` go on from the end of `shorter`; else why it cannot."""
    name = f"that of {shorter.identity['env_steps']} steps"
    if is_file(run.folder(cell) / CHECKPOINT):
        return ""
    if shorter.status.state != "done":
        return f"{name} is {shorter.status.state}"
    if not is_file(shorter.folder / CHECKPOINT):
        return f"{name} left no checkpoint (deleted, or its learner or backend cannot go on to the same bits)"
    if shorter.status.source != source_of(cell, installed()):
        return f"{name} was made by other source code"
    run.begin_with(cell, shorter.folder / CHECKPOINT)
    return ""


def _by_all_but_budget(cells: Iterable[StoredCell]) -> dict[str, StoredCell]:
    """What cells of different budgets share -> the one with the largest."""
    return {_key(cell): cell for cell in sorted(cells, key=lambda cell: int(cell.identity["env_steps"]))}


def _key(cell: StoredCell | LearnerCell) -> str:
    return content_hash(but_budget(cell.identity), digits=64)
