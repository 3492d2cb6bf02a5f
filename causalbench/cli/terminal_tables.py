"""Tables for people, on the terminal."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from causalbench.cli.progress import duration
from causalbench.cli.visible import VisibleConsole
from causalbench.core.discovery.graph import CausalGraph, StageGraph
from causalbench.plugins.backends import Variant
from causalbench.plugins.manager import Plugins
from causalbench.run.doctor import Finding
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder

if TYPE_CHECKING:
    from causalbench.run.verify import Verdict
    from causalbench.run.watch import RunStatus

Row = Mapping[str, Any]

BOARD = {
    "rank": "rank", "method": "method", "grid_point": "grid point", "backend": "backend",
    "seeds": "seeds", "success_auc_iqm": "success AUC (IQM)",
    "steps_to_90": "steps to 90%", "steps_to_90_with_discovery": "with discovery",
    "success_deterministic": "success", "success_sampled": "sampled", "held_rate": "held",
    "reversals_per_1000_steps": "reversals/1000", "failed_cells": "failed", "verdict": "verdict",
}  # fmt: skip
"""Column of `leaderboard.csv` -> its heading on the terminal."""


def progress_console() -> VisibleConsole:
    """Progress goes to stderr, so that stdout holds results alone."""
    return VisibleConsole(stderr=True)


def print_hypotheses(verdicts: Iterable[Row]) -> None:
    """The verdicts on success areas, a sentence each: what was stated before the run comes first."""
    areas = [row for row in verdicts if row["measure"] == "success_auc"]
    for row in sorted(areas, key=lambda row: -row["stated"]):
        print_content(row["sentence"])


def print_leaderboard(rows: Sequence[Row]) -> None:
    """The leaderboard; the lowest and the highest seed stand in brackets behind the area."""
    columns = {
        key: name for key, name in BOARD.items() if key != "grid_point" or any(row["grid_point"] for row in rows)
    }
    table = Table(
        *columns.values(), title="Leaderboard: area under the success curve (exploratory)", title_justify="left"
    )
    for row in rows:
        cells = {key: _text(row.get(key)) for key in BOARD} | _censored(row)
        if row.get("success_auc_lowest") is not None:
            cells["success_auc_iqm"] += f" [{row['success_auc_lowest']:.3f}, {row['success_auc_highest']:.3f}]"
        if row.get("rank") not in (None, row.get("worst_rank")):
            cells["rank"] += f"-{row['worst_rank']}"
        if row.get("p_better_than_next") is not None:
            cells["verdict"] += f", P(better) {row['p_better_than_next']:.2f}"
        table.add_row(*(escape(cells[key]) for key in columns))
    print_content(table)
    if (most := max((row["sources"] for row in rows), default=0)) > 1:
        print_content(
            f"These cells were made by {most} versions of the source code: `source` in results.csv says which."
        )


def _censored(row: Row) -> dict[str, str]:
    """What stands for steps that were more than the budget."""
    never = row.get("budget") is not None and row["steps_to_90"] is None
    return dict.fromkeys(("steps_to_90", "steps_to_90_with_discovery"), f">{row['budget']}") if never else {}


def print_known_gaps(runs: Iterable[RunFolder]) -> None:
    """A footnote of the leaderboard: which lines of the contract the backends of `runs` are known not to keep."""
    for line in dict.fromkeys(
        f"Known gap of {backend}: {number}, {reason}"
        for run in runs
        for backend, gaps in run.known_gaps().items()
        for number, reason in gaps.items()
    ):
        print_content(line)


def print_problems(runs: Iterable[RunFolder]) -> None:
    """A line on stderr for everything in `runs` that is damaged, and so is not counted."""
    for run in runs:
        for sentence in run.problems():
            progress_console().print(f"not counted: {sentence}", markup=False, highlight=False, soft_wrap=True)


def print_unfinished(statuses: Mapping[str, Status], folder: Path) -> None:
    """A line for every cell that is not done, then where the files are."""
    for name, status in statuses.items():
        if status.state != "done":
            print_content(f"{name}: {status.state}. {status.reason}")
    print_content(f"Tables and policies: {folder}")


def print_verdicts(verdicts: Sequence[Verdict], changes: Sequence[str]) -> None:
    """What running cells again said, and what has changed since they ran first."""
    table = Table("cell", "agrees", "result", "differing files", title="Cells run again", title_justify="left")
    for verdict in verdicts:
        agrees = "yes" if verdict.agrees else "no"
        table.add_row(*map(escape, (verdict.cell, agrees, verdict.result, ", ".join(verdict.differing))))
    print_content(table)
    for change in changes:
        print_content(f"Changed since: {change}")


def print_plan(rows: Sequence[Row], folder: Path, jobs: int) -> None:
    """What would run, and what it would take with `jobs` cells at a time."""
    columns = ("cell", "kind", "state", "steps", "time", "disk", "memory")
    table = Table(*columns, title=f"Plan for {folder}", title_justify="left")
    for row in rows:
        taken = "" if row["seconds"] is None else duration(row["seconds"])
        disk, memory = (_bytes(row[key]) if row[key] else "" for key in ("disk", "memory"))
        steps = "" if row["env_steps"] is None else f"{row['env_steps']:,}"
        table.add_row(row["cell"], row["kind"], row["state"], steps, taken, disk, memory)
    print_content(table)
    left = [row for row in rows if row["state"] not in ("done", "skipped")]
    total = sum(row["env_steps"] or 0 for row in left)
    print_content(f"{len(left)} of {len(rows)} cells to run, {total:,} steps of training beside those of discovery")
    if any(row["seconds"] is None for row in left):
        print_content("No estimate for some cells: no such cell has run in this folder yet; --measure tries them.")
    else:
        seconds = [row["seconds"] for row in left]
        most = duration(max([sum(seconds) / jobs, *seconds]))
        print_content(f"About {most} left, {jobs} cells at a time{_room(left, jobs)}.")


def _room(rows: Sequence[Row], jobs: int) -> str:
    """What cells need of disk and memory, `jobs` at a time, where it was measured."""
    disk, memory = ([row[key] for row in rows if row[key]] for key in ("disk", "memory"))
    if not disk:
        return ""
    return f"; {_bytes(sum(disk))} on the disk, {_bytes(sum(sorted(memory)[-jobs:]))} of memory"


def _bytes(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{number / 1e6:.0f} MB"


def print_status(found: RunStatus) -> None:
    """How a run stands: a line in all, one for each running cell, two for each that ended badly."""
    states = ", ".join(f"{number} {state}" for state, number in found.states.items())
    left = "" if found.left is None else f", about {duration(found.left)} left"
    print_content(f"{found.folder}: {100 * found.fraction:.0f}% of {found.planned} cells ({states}){left}")
    idle = "finished" if set(found.states) == {"done"} else "nobody works on it; `causalbench run` goes on with it"
    print_content(f"  held by {found.holder}" if found.holder else f"  {idle}")
    for cell in found.running:
        rest = "" if cell.left is None or not found.holder else f", {duration(cell.left)} left"
        name = f"{cell.method} on {cell.backend}, seed {cell.seed}"
        print_content(f"  {name}: {100 * cell.fraction:.0f}% {cell.text}{rest}")
    for failure in found.failures:
        print_content(f"  {failure.cell} {failure.state}: {failure.reason}")
        print_content(f"    {failure.log}")


def print_graph(graph: CausalGraph, folder: Path) -> None:
    """Per stage the matrix beside the main column of the evidence; a selected action is marked."""
    for stage in graph.stages:
        print_content(_stage_table(graph, stage))
        for note in stage.notes:
            print_content(f"Stage {stage.stage}: {note}")
    if main := graph.main_column:
        print_content(f"X: selected, ?: undecided; {main.name}: {main.sentence}")
    print_content(f"Causal graph {graph.hash}, {graph.env_steps} environment steps; written to {folder}")


def print_oracle(graph: CausalGraph, folder: Path) -> None:
    """Every edge that is there or was selected, with its effect and grade, then the scores, from a cell's `folder`."""
    import pandas as pd

    edges = Table("stage", "term", "action", "effect", "interval", "grade", "selected", title="Oracle")
    for row in pd.read_csv(folder / "oracle.csv").to_dict("records"):
        if row["grade"] != "absent" or row["selected"]:
            interval = escape(f"[{row['effect_low']:.4f}, {row['effect_high']:.4f}]")
            named = (str(row[key]) for key in ("stage", "term", "action"))
            edges.add_row(*named, f"{row['effect']:.4f}", interval, row["grade"], "X" if row["selected"] else "")
    print_content(edges)
    scores = Table("stage", "precision", "recall", "F1", "SHD", "F1, weak counted", title="Score on strong edges")
    for row in pd.read_csv(folder / "score.csv").to_dict("records"):
        ratios = [f"{row[key]:.3f}" for key in ("precision", "recall", "f1")]
        scores.add_row(str(row["stage"]), *ratios, str(row["shd"]), f"{row['f1_weak_present']:.3f}")
    print_content(scores)
    print_content(_floor(graph))


def _floor(graph: CausalGraph) -> str:
    """What the oracle took, and how small an effect it can see."""
    took = f"The oracle took {graph.oracle['env_steps']} environment steps of its own"
    if graph.oracle["exact_restore"]:
        return f"{took}; snapshots restore exactly, so its error floor is 0."
    floors = [
        (value, f"{term} of stage {stage}")
        for stage, row in graph.oracle["floor"].items()
        for term, value in row.items()
        if value is not None
    ]
    value, where = max(floors, default=(0.0, "none"))
    return f"{took}; restoring is not exact: repeating the same action shows effects up to {value:.2g} ({where})."


def _stage_table(graph: CausalGraph, stage: StageGraph) -> Table:
    causal = ", ".join(stage.causal_actions()) or "none"
    enough = "" if stage.sufficient is None else f"; enough for a policy: {', '.join(stage.sufficient)}"
    table = Table("action", title=f"Stage {stage.stage}: causal actions {causal}{enough}", title_justify="left")
    name = graph.main_column.name if graph.main_column else ""
    for term in stage.terms:
        table.add_column(f"{term}\nselected  {name:>8}")
    for row, action in enumerate(stage.actions):
        table.add_row(action, *(_edge(stage, name, row, column) for column in range(len(stage.terms))))
    for column in graph.columns:
        if column.per == "term" and column.name in stage.evidence:
            table.add_row(column.name, *(f"          {value:8.2f}" for value in stage.evidence[column.name]))
    return table


def _edge(stage: StageGraph, name: str, row: int, column: int) -> str:
    number = f"{stage.evidence[name][row, column]:8.4f}" if name in stage.evidence else ""
    marks = {"present": "X", "absent": ".", "undecided": "?"}
    return f"   {marks[stage.outcome(row, column)]}      {number}"


def print_backends(plugins: Plugins) -> None:
    """One row per robot of a backend and one per plugin that could not be loaded."""
    table = Table("backend", "options", "engine", "robot", "plugin", "version", "capabilities", "known gaps", "state")
    for name, backend in sorted(plugins.backends.items()):
        owner = plugins.owners[name]
        state = plugins.problem(name) or "ok"
        gaps = "; ".join(f"{number}: {reason}" for number, reason in backend.known_gaps.items()) or "none"
        for variant in backend.variants or (Variant("the task's"),):
            options = " ".join(f"{key}={json.dumps(value)}" for key, value in variant.options.items())
            can = ", ".join(sorted(variant.capabilities)) or ("none" if backend.make else "the task's")
            cells = (name, options, backend.engine, variant.robot, owner.distribution, owner.version, can, gaps, state)
            table.add_row(*map(escape, cells))
    for row in plugins.rows:
        if row.error:
            table.add_row(
                "-", "", "", "", row.distribution, row.version, "", "", f"could not be loaded: {escape(row.error)}"
            )
    print_content(table)


def print_checks(subject: str, results: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per line of the contract, in colour, and a summary; the rows, for the caller."""
    colours = {"pass": "green", "fail": "red", "warning": "yellow", "known gap": "yellow", "not applicable": "dim"}
    table = Table("", "contract", "outcome", "message", title=f"Conformance of {subject}", title_justify="left")
    rows = []
    with progress_console().status(f"checking {subject}"):
        for row in results:
            rows.append(row)
            outcome = f"[{colours[row['outcome']]}]{row['outcome']}[/]"
            table.add_row(row["number"], escape(row["sentence"]), outcome, escape(row["message"]))
    print_content(table)
    counts = {outcome: sum(row["outcome"] == outcome for row in rows) for outcome in colours}
    seconds = sum(row["seconds"] for row in rows)
    print_content(", ".join(f"{outcome}: {count}" for outcome, count in counts.items()) + f" ({seconds:.0f} s)")
    for row in rows:
        if row["outcome"] in ("fail", "warning"):
            print_content(f"{row['number']} in full, and what is measured: {row['place']}")
    return rows


def print_finding(finding: Finding) -> None:
    """One line of `doctor`, and one more with advice if something is wrong."""
    print_content(f"{'ok  ' if finding.ok else 'FAIL'}  {finding.subject}: {finding.text}")
    if not finding.ok:
        print_content(f"      {finding.advice}")


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def print_content(content: Table | str) -> None:
    """Print a table, or a sentence that may hold anything, with what could steer a terminal shown and not obeyed."""
    console = VisibleConsole()
    if not console.is_terminal:
        # A pipe has no width: do not fold what a program or a grep reads.
        console = VisibleConsole(width=1000)
    console.print(content, highlight=False, soft_wrap=isinstance(content, str), markup=not isinstance(content, str))
