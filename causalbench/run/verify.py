"""`causalbench verify`: run a few cells of a run again, in fresh processes, and compare what they leave."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from causalbench.errors import UserError
from causalbench.plugins.manager import Plugins
from causalbench.run.cell import Keeping
from causalbench.run.executors.processes import Processes
from causalbench.run.executors.schedule import schedule
from causalbench.run.session import describe_environment
from causalbench.run.view import View
from causalbench.store.cells import Status, StoredCell
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell, LearnerCell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite

COMPARED = ("python", "platform", "cpu", "packages", "plugins")
"""What of a session's environment can change a number."""


@dataclass(frozen=True)
class Verdict:
    """What running one cell again said.

    `agrees` if every result file has the same bytes, else `differing` names those that have not, and `result` says
    whether the result itself still agrees: success within the 95% intervals of both, or the same causal matrix.
    """

    cell: str
    agrees: bool
    differing: tuple[str, ...]
    result: str


def verify(
    run: RunFolder, plugins: Plugins, count: int, seed: int, jobs: int, view: View
) -> tuple[list[Verdict], list[str]]:
    """Run `count` finished cells of `run` again, drawn by `seed`; a verdict each, and what has changed since.

    Learners use the graph that lies in `run`, unless its discovery is drawn, too. Nothing in `run` is written.
    Raises `UserError` when no finished cell can be made from its `suite.yaml` as things are.
    """
    chosen = random.Random(seed).sample(*_drawn_from(run, plugins, count))
    with TemporaryDirectory(prefix="causalbench-verify-") as place:
        again = RunFolder(Path(place) / "run")
        with again.claim():
            for cell in chosen:
                _bring_graph(cell, chosen, run, again)
            ended = list(_run(chosen, again, jobs, view))
        verdicts = [compare(run.stored(cell), again, cell, status) for cell, status in ended]
    sources = {run.stored(cell).status.source for cell in chosen}, {status.source for _, status in ended}
    return sorted(verdicts, key=lambda verdict: verdict.cell), [*_code(*sources), *_environment(run, plugins, chosen)]


def _drawn_from(run: RunFolder, plugins: Plugins, count: int) -> tuple[list[Cell], int]:
    """The finished cells that `suite.yaml` makes, and how many of them to draw."""
    path = run.path / "suite.yaml"
    if not path.is_file():
        raise UserError(f"{path}: missing, so {run.path} is no run folder that can be verified")
    file = load_suite(path, plugins)
    made = {cell.id: cell for tier in file.suite.tiers for cell in make_plan(file, tier, plugins).cells}
    finished = [stored.id for stored in run.cells() if stored.status.state == "done"]
    found = [made[name] for name in finished if name in made]
    if not found:
        raise UserError(
            f"{run.path}: none of its {len(finished)} finished cells is one that {path} makes with what is installed "
            "here: a cell's id covers the versions of causalbench, of the backend and of its engine"
        )
    return found, min(count, len(found))


def _bring_graph(cell: Cell, chosen: Sequence[Cell], run: RunFolder, again: RunFolder) -> None:
    """Copy the discovery that `cell` needs, unless it is run again itself or there already."""
    needed = cell.discovery if isinstance(cell, LearnerCell) else None
    if needed is not None and needed not in chosen and not again.folder(needed).exists():
        shutil.copytree(run.folder(needed), again.folder(needed))


def _run(chosen: Sequence[Cell], again: RunFolder, jobs: int, view: View) -> Iterator[tuple[Cell, Status]]:
    view.begin(chosen, chosen, again)
    try:
        executor = Processes(again, view.on_progress, Keeping(), jobs)
        for cell, status in schedule(chosen, again, executor):
            view.on_outcome(cell, status)
            yield cell, again.status(cell)
    finally:
        view.end()


def compare(before: StoredCell, again: RunFolder, cell: Cell, status: Status) -> Verdict:
    """What `before` and the same cell in `again`, which ended with `status`, have in common."""
    if status.state != "done":
        return Verdict(cell.id, False, (), f"ended {status.state} this time: {status.reason}")
    files, now = before.status.files, status.files
    differing = tuple(sorted(name for name in files.keys() | now.keys() if files.get(name) != now.get(name)))
    if not differing:
        return Verdict(cell.id, True, (), "bit for bit the same")
    return Verdict(cell.id, False, differing, _result(before, again.stored(cell)))


def _result(before: StoredCell, now: StoredCell) -> str:
    """Whether the results agree where the files do not."""
    if before.kind == "discovery":
        pairs = zip(before.graph().stages, now.graph().stages, strict=True)
        edges = sum(int((old.matrix != new.matrix).sum()) for old, new in pairs)
        return "the same causal matrix" if edges == 0 else f"{edges} edges of the causal matrix differ"
    from scipy.stats import binomtest

    one, other = before.evaluations()[-1], now.evaluations()[-1]
    then, later = (
        binomtest(round(found.success_deterministic * found.episodes), found.episodes).proportion_ci(method="wilson")
        for found in (one, other)
    )
    apart = then.low > later.high or later.low > then.high
    return (
        f"success {one.success_deterministic:g} then, {other.success_deterministic:g} now, "
        f"{'beyond' if apart else 'within'} the 95% intervals of {one.episodes} episodes"
    )


def _code(then: set[str], now: set[str]) -> Iterator[str]:
    if then != now:
        yield f"the source code: {', '.join(sorted(then))} then, {', '.join(sorted(now))} now"


def _environment(run: RunFolder, plugins: Plugins, chosen: Sequence[Cell]) -> Iterator[str]:
    """What of the machine and its packages is not as in any session of `run`."""
    now = describe_environment(plugins, sorted({cell.backend.name for cell in chosen}))
    sessions = run.sessions()
    for key in COMPARED:
        then: list[Any] = [session.get(key) for session in sessions]
        if now[key] not in then:
            yield f"{key}: {_difference(then[-1] if then else None, now[key])}"


def _difference(then: Any, now: Any) -> str:
    if not isinstance(then, Mapping) or not isinstance(now, Mapping):
        return f"{then} then, {now} now"
    names = sorted(name for name in then.keys() | now.keys() if then.get(name) != now.get(name))
    return ", ".join(f"{name} {then.get(name)} then, {now.get(name)} now" for name in names)
