"""What became of each stage that was reached: held, won back, lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from causalbench.report.drawing import STAGE_COLOURS
from causalbench.report.html.drawings import INK, LEFT, SIZE
from causalbench.report.html.multiples import Multiples
from causalbench.report.html.source import Source
from causalbench.report.html.wording import by_entry

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FATES = {
    "episodes_held": ("held", STAGE_COLOURS[2], ""),
    "episodes_recovered": ("fell back, recovered", STAGE_COLOURS[4], ""),
    "episodes_lost": ("fell back, lost for good", STAGE_COLOURS[5], "////"),
}
"""Column of `stage_account.csv` -> words, colour and hatch; every episode that reached a stage has one of them."""
GROUP = ["backend", "method", "grid_point"]
COUNTS = [
    "episodes",
    "episodes_reached",
    "episodes_held",
    "episodes_fell_back",
    "episodes_recovered",
    "episodes_lost",
    "falls",
]


def pooled(account: pd.DataFrame) -> pd.DataFrame:
    """Rows of `stage_account.csv` added up over seeds; `held_least` and `held_most` are shares of single seeds."""
    account = account.astype({"stage": int})
    held = (account["episodes_held"] / account["episodes"]).astype(float)
    groups = account.assign(held=held).groupby([*GROUP, "stage"])
    found = groups[COUNTS].sum().assign(seeds=groups["seed"].nunique())
    return found.assign(held_least=groups["held"].min(), held_most=groups["held"].max()).reset_index()


@dataclass(frozen=True)
class Flow:
    """One method: per stage, the share of its episodes that reached it, and what became of it."""

    title: str
    own: pd.DataFrame
    size: tuple[float, float] = SIZE
    left: float = LEFT

    def paint(self, ax: Axes) -> None:
        """Draw it."""
        at, below = np.arange(len(self.own)), np.zeros(len(self.own))
        ax.bar(at, 1.0, width=0.78, facecolor="none", edgecolor=INK, lw=0.5, alpha=0.35)
        for name, (_, colour, hatch) in FATES.items():
            share = (self.own[name] / self.own["episodes"]).to_numpy(float)
            ax.bar(at, share, bottom=below, width=0.78, facecolor=colour, edgecolor="white", hatch=hatch, lw=0)
            below += share
        last = len(self.own) - 1
        ax.set_xticks(at, [str(stage) if i < last else "success" for i, stage in enumerate(self.own["stage"])])
        ax.set(ylim=(0, 1.0), yticks=[0, 0.5, 1], xlabel="stage", ylabel="share of episodes")


def multiples(source: Source) -> Iterator[Multiples]:
    """The panels of each backend."""
    table = pooled(source.tables.stage_account)
    for backend, here in table.groupby("backend"):
        panels = [Flow(name, own) for name, own in by_entry(here).items()]
        yield Multiples(
            name=f"stages-{backend}",
            title=str(backend),
            backend=str(backend),
            panels=panels,
            alts=[_alt(panel, str(backend)) for panel in panels],
            methods=[str(panel.own["method"].iloc[0]) for panel in panels],
            data=here,
            keys={words: colour for words, colour, _ in FATES.values()},
        )


def _alt(panel: Flow, backend: str) -> str:
    said = [
        f"{'success' if i == len(panel.own) - 1 else f'stage {row.stage}'} {row.episodes_reached} of {row.episodes}, "
        f"held {row.episodes_held}, recovered {row.episodes_recovered}, lost {row.episodes_lost}"
        for i, row in enumerate(panel.own.itertuples())
    ]
    return f"Stages reached by {panel.title} on {backend}: {'; '.join(said)}."
