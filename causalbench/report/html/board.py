"""The leaderboard: a table per board, and every seed behind it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from causalbench.report.drawing import STAGE_COLOURS
from causalbench.report.frames import records
from causalbench.report.html.drawings import INK
from causalbench.report.html.multiples import Multiples
from causalbench.report.html.parts import Download, Fold, Note, Row, Section, Table, Value
from causalbench.report.html.source import Source
from causalbench.report.html.wording import NOTHING, column, entry, listed, number, percent, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = (
    column("rank"), column("worst_rank", "worst rank"), column("method", numeric=False), column("seeds"),
    column("success_auc_iqm", "success AUC (IQM)"), column("success_deterministic", "final success"),
    column("success_sampled", "sampled"), column("held_rate", "held"), column("steps_to_90", "steps to 90%"),
    column("steps_to_90_with_discovery", "with discovery"), column("reached_90", "reached 90%"),
    column("reversals_per_1000_steps", "reversals per 1,000 training steps"),
    column("failed_cells", "failed cells"), column("verdict", numeric=False),
)  # fmt: skip
LEAD = (
    "Exploratory: what was stated before the run stands above. The order is that of the area under the success curve "
    "up to the budget, the interquartile mean over seeds; brackets and bars go from the lowest seed to the highest. "
    "Ranks are the best and the worst that exact tests of all pairs of methods allow; a method with unfinished cells "
    "has none. Steps are environment steps; > means that fewer than half of the seeds got there within the budget."
)


def section(source: Source) -> Section:
    """A table per board and a picture of all seeds per backend."""
    board = source.tables.leaderboard
    if board.empty:
        return Section("leaderboard", "Leaderboard", "", [Note("This run trains nothing: it has no leaderboard.")])
    tables = [_table(str(name), rows) for name, rows in board.groupby("backend", sort=False)]
    blocks: list[Any] = [*_mixed(board), *tables[:1], *_agreement(source)]
    blocks += [Fold("Each backend by itself", tables[1:])] if len(tables) > 2 else tables[1:]
    blocks += [found.block() for found in multiples(source)]
    return Section("leaderboard", "Leaderboard", LEAD, blocks)


def _mixed(board: pd.DataFrame) -> list[Note]:
    mixed = board[board["sources"] > 1]["backend"].unique()
    told = f"The cells of {listed(mixed)} were made by several versions of the source code; results.csv says which."
    return [Note(told, "warn")] if mixed.size else []


def _agreement(source: Source) -> list[Table]:
    """Whether the backends rank the methods alike."""
    rows = [
        Row(
            [
                text(row["backend"]), text(row["other_backend"]), number(row["methods"], 0),
                number(row["kendall_tau"], 2), number(row["p_value"], 3),
            ],
            row["backend"],
        )
        for row in records(source.tables.agreement)
    ]  # fmt: skip
    columns = [
        column("backend", numeric=False), column("other_backend", "other", numeric=False), column("methods"),
        column("kendall_tau", "Kendall's tau"), column("p_value", "p"),
    ]  # fmt: skip
    return [Table("Whether backends rank methods alike", columns, rows)] if rows else []


def _table(board: str, rows: pd.DataFrame) -> Table:
    title = "All backends together" if board == "all" else board
    found = [_row(board, row) for row in records(rows)]
    return Table(title, COLUMNS, found, Download.csv(f"leaderboard-{board}.csv", rows)).without_empty_columns()


def _row(board: str, row: dict[str, Any]) -> Row:
    failed = Value(str(row["failed_cells"]), row["failed_cells"], mark="warn" if row["failed_cells"] else "")
    values = [
        number(row["rank"], 0), number(row["worst_rank"], 0), text(entry(row)), number(row["seeds"], 0), _area(row),
        percent(row["success_deterministic"]), percent(row["success_sampled"]),
        percent(row["held_rate"]), steps(row, "steps_to_90"), steps(row, "steps_to_90_with_discovery"),
        number(row["reached_90"], 0), number(row["reversals_per_1000_steps"], 2), failed, text(_verdict(row)),
    ]  # fmt: skip
    return Row(values, "" if board == "all" else board, row["method"])


def _area(row: dict[str, Any]) -> Value:
    middle, low, high = (row[f"success_auc_{end}"] for end in ("iqm", "lowest", "highest"))
    if middle is None:
        return NOTHING
    return Value(f"{middle:.3f} [{low:.3f}, {high:.3f}]", middle, (low, middle, high))


def steps(row: dict[str, Any], name: str) -> Value:
    """Steps to 90% success; beyond the budget where that was not reached."""
    if row[name] is None and row["budget"] is not None:
        return Value(f">{number(row['budget'], 0).text}", float("inf"))
    return number(row[name], 0)


def _verdict(row: dict[str, Any]) -> str:
    if row["p_better_than_next"] is None:
        return str(row["verdict"])
    return f"{row['verdict']}, P(better) {row['p_better_than_next']:.2f}"


@dataclass(frozen=True)
class Seeds:
    """Every seed of every method of a backend as a dot, the IQM as a bar."""

    title: str
    areas: dict[str, list[float]]
    board: dict[str, dict[str, Any]]

    @property
    def size(self) -> tuple[float, float]:
        """A line per method."""
        return 4.0 + self.left, 0.55 + 0.3 * len(self.areas)

    @property
    def left(self) -> float:
        """Room for the longest name."""
        return 0.2 + 0.075 * max(map(len, self.areas))

    def paint(self, ax: Axes) -> None:
        """Draw it."""
        for y, (name, areas) in enumerate(self.areas.items()):
            ax.plot(areas, [y] * len(areas), "o", mfc="none", mec=STAGE_COLOURS[0], ms=5, mew=1.1)
            row = self.board[name]
            ax.plot([row["success_auc_iqm"]] * 2, [y - 0.33, y + 0.33], color=INK, lw=2)
        ax.set_yticks(range(len(self.areas)), list(self.areas))
        ax.set(xlim=(-0.02, 1.02), ylim=(len(self.areas) - 0.4, -0.6), xlabel="area under the success curve")


def multiples(source: Source) -> Iterator[Multiples]:
    """One panel per backend."""
    for backend, here in source.tables.results.groupby("backend"):
        board = source.tables.leaderboard.query("backend == @backend and not success_auc_iqm.isna()")
        by_name = {entry(row): row for row in records(board)}
        found: dict[str, list[float]] = {entry(row): [] for row in by_name.values()}
        for row in records(here):
            found[entry(row)].append(row["success_auc"])
        panel = Seeds(f"Every seed on {backend}", found, by_name)
        alt = "; ".join(f"{name} {', '.join(f'{area:.2f}' for area in areas)}" for name, areas in found.items())
        yield Multiples(
            name=f"seeds-{backend}",
            title=f"Every seed on {backend}",
            backend=str(backend),
            panels=[panel],
            alts=[f"Area under the success curve of every seed on {backend}: {alt}."],
            methods=[""],
            data=here[["backend", "method", "grid_point", "seed", "success_auc"]],
            note="Rings are seeds; the bar is their interquartile mean.",
        )
