"""Which steps led from one stage to another: stages in a row, ways forward above, reversals below."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from causalbench.report.drawing import STAGE_COLOURS
from causalbench.report.frames import records
from causalbench.report.html import flow
from causalbench.report.html.drawings import INK
from causalbench.report.html.multiples import Multiples
from causalbench.report.html.source import Source
from causalbench.report.html.wording import by_entry

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORWARD, BACK = STAGE_COLOURS[2], STAGE_COLOURS[5]
BEND = 0.6  # of an arc, in its length
WIDEST = 4.0  # points, of a way that a hundred steps in a thousand take


def rates(moves: pd.DataFrame) -> pd.DataFrame:
    """Rows of `moves.csv` added up over seeds, those to another stage, with `rate` per 1,000 steps of the method."""
    found = moves.astype({"to_stage": int}).groupby([*flow.GROUP, "from_stage", "to_stage"])["count"].sum()
    rate = 1000 * found / found.groupby(flow.GROUP).transform("sum")
    table = pd.DataFrame({"count": found, "rate": rate}).reset_index()
    return table[table["from_stage"] != table["to_stage"]]


@dataclass(frozen=True)
class Transitions:
    """One method: its ways from stage to stage; success is the stage `n_stages` + 1."""

    title: str
    own: pd.DataFrame
    n_stages: int
    size: tuple[float, float] = (2.9, 1.9)
    left: float = 0.1

    def paint(self, ax: Axes) -> None:
        """Draw it."""
        last = self.n_stages + 1
        for row in records(self.own):
            _way(ax, row["from_stage"], row["to_stage"], row["rate"])
        for stage in range(1, last + 1):
            name = "success" if stage == last else str(stage)
            ax.text(stage, 0, name, ha="center", va="center", size=7 if stage == last else 9)
            ax.plot(stage, 0, "o", ms=17 if stage < last else 0, mfc="none", mec=INK, mew=0.8)
        height = BEND / 2 * self.n_stages + 0.3
        ax.set(xlim=(0.6, last + 0.6), ylim=(-height, height), aspect="equal")
        ax.set_axis_off()


def _way(ax: Axes, start: int, end: int, rate: float) -> None:
    """An arc above the stages where it goes on, below them where it goes back."""
    width = WIDEST * 2 ** np.log10(rate / 100)
    arrow = {
        "arrowstyle": "-|>,head_width=0.25,head_length=0.4", "connectionstyle": f"arc3,rad={-BEND}", "shrinkA": 9,
        "shrinkB": 9, "lw": width, "color": FORWARD if end > start else BACK,
    }  # fmt: skip
    ax.annotate("", (end, 0), (start, 0), arrowprops=arrow)
    height = BEND / 2 * (end - start) + np.copysign(0.15, end - start)  # half of the bend is the arc's height
    ax.text((start + end) / 2, height, _words(rate), ha="center", va="center", size=6.5)


def _words(rate: float) -> str:
    return f"{rate:.0f}" if rate >= 10 else f"{rate:.2g}"


def multiples(source: Source) -> Iterator[Multiples]:
    """The panels of each backend."""
    table = rates(source.tables.moves)
    n_stages = 0 if table.empty else int(source.tables.episodes["n_stages"].max())
    for backend, here in table.groupby("backend"):
        panels = [Transitions(name, own, n_stages) for name, own in by_entry(here).items()]
        yield Multiples(
            name=f"transitions-{backend}",
            title=f"Ways from stage to stage: {backend}",
            backend=str(backend),
            panels=panels,
            alts=[_alt(panel) for panel in panels],
            methods=[str(panel.own["method"].iloc[0]) for panel in panels],
            data=here,
            note="Steps in a thousand; a way of a tenth as many is half as wide.",
            keys={"on": FORWARD, "back": BACK},
        )


def _alt(panel: Transitions) -> str:
    said = [f"{row['from_stage']} to {row['to_stage']} {_words(row['rate'])}" for row in records(panel.own)]
    return f"Steps of {panel.title} in a thousand that led from stage to stage: {', '.join(said)}."
