"""Success over steps: what training takes, and what it takes with the discovery before it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from causalbench.report import stats
from causalbench.report.drawing import STAGE_COLOURS
from causalbench.report.frames import records
from causalbench.report.html.board import steps
from causalbench.report.html.drawings import INK, LEFT, SIZE
from causalbench.report.html.multiples import Multiples
from causalbench.report.html.parts import Note, Row, Section, Table
from causalbench.report.html.source import Source
from causalbench.report.html.wording import by_entry, column, entry, number, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINE = STAGE_COLOURS[0]
CURVE = ("task", "backend", "method", "grid_point")


def bands(source: Source, with_discovery: bool) -> pd.DataFrame:
    """The curve of each backend, method and point of a grid: median over seeds, its interval, and the seeds' range.

    A seed's curve is linear between evaluations, from 0 on, and goes on at its last value where training stopped early:
    the area under it is its `success_auc`. `low` and `high` are missing for fewer than six seeds. With
    `with_discovery` the steps of the discovery come first, during which there is no success.
    """
    results, curves = source.tables.results, source.tables.curves
    found = [
        _band(own, curves.merge(own[[*CURVE, "seed"]], on=[*CURVE, "seed"]), with_discovery)
        for _, own in results.groupby(list(CURVE), dropna=False)
    ]
    columns = [*CURVE[1:], "env_steps", "success", "low", "high", "least", "most", "seeds"]
    return pd.concat(found)[columns] if found else pd.DataFrame(columns=columns)


def _band(results: pd.DataFrame, curves: pd.DataFrame, with_discovery: bool) -> pd.DataFrame:
    budget = int(results["budget"].max())
    offsets = dict(zip(results["seed"], results["discovery_env_steps"], strict=True)) if with_discovery else {}
    seeds = [
        (
            int(offsets.get(seed, 0)),
            own["env_steps"].to_numpy(int).clip(max=budget),
            own["success_deterministic"].to_numpy(float),
        )
        for seed, own in curves.groupby("seed")
    ]
    end = budget + max(offset for offset, _, _ in seeds)
    knots = [[0, offset, end, *(offset + steps)] for offset, steps, _ in seeds]
    grid = np.unique(np.concatenate(knots))
    values = np.array(
        [np.interp(grid, [offset, *(offset + steps)], [0.0, *success]) for offset, steps, success in seeds]
    )
    low, high = stats.median_interval(values.T)
    shown = {
        "success": np.median(values, axis=0),
        "low": low,
        "high": high,
        "least": values.min(0),
        "most": values.max(0),
    }
    named = {name: results[name].iloc[0] for name in CURVE}
    return pd.DataFrame({"env_steps": grid} | shown).assign(seeds=len(seeds), **named)


@dataclass(frozen=True)
class Curve:
    """One method's curve and bands; the medians of the others of the backend stand behind it."""

    title: str
    own: pd.DataFrame
    others: list[pd.DataFrame]
    end: int
    size: tuple[float, float] = SIZE
    left: float = LEFT

    def paint(self, ax: Axes) -> None:
        """Draw it."""
        for other in self.others:
            ax.plot(other["env_steps"], other["success"], color=INK, alpha=0.22, lw=0.9)
        steps = self.own["env_steps"]
        ax.fill_between(steps, self.own["least"], self.own["most"], color=LINE, alpha=0.16, lw=0)
        ax.fill_between(steps, self.own["low"], self.own["high"], color=LINE, alpha=0.32, lw=0)
        ax.plot(steps, self.own["success"], color=LINE, lw=1.8)
        ax.set(xlim=(0, self.end), ylim=(-0.03, 1.03), yticks=[0, 0.5, 1], xlabel="environment steps", ylabel="success")
        ax.xaxis.set_major_locator(_steps_ticks())
        ax.xaxis.set_major_formatter(lambda x, _: f"{x / 1000:g}k" if x else "0")


def _steps_ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4)


def multiples(source: Source, with_discovery: bool) -> Iterator[Multiples]:
    """The panels of each backend."""
    table = bands(source, with_discovery).astype({"low": float, "high": float})
    for backend, here in table.groupby("backend"):
        curves = by_entry(here)
        end = int(here["env_steps"].max())
        panels = [
            Curve(name, own, [other for other in curves.values() if other is not own], end)
            for name, own in curves.items()
        ]
        kind = "with discovery" if with_discovery else "training alone"
        yield Multiples(
            name=f"{'cost' if with_discovery else 'curves'}-{backend}",
            title=str(backend),
            backend=str(backend),
            panels=panels,
            alts=[_alt(panel, str(backend), kind) for panel in panels],
            methods=[str(panel.own["method"].iloc[0]) for panel in panels],
            data=here,
            keys=_keys(panels),
        )


def _keys(panels: list[Curve]) -> dict[str, str]:
    """What line and bands are, those that are there."""
    keys = {"median of the seeds": LINE}
    if any(panel.own["low"].notna().any() for panel in panels):
        keys["its 95% interval"] = f"{LINE}73"
    if any((panel.own["seeds"] > 1).any() for panel in panels):
        keys["from the worst seed to the best"] = f"{LINE}29"
    return keys | ({"other methods": "gray"} if len(panels) > 1 else {})


def _alt(panel: Curve, backend: str, kind: str) -> str:
    last, most = panel.own["success"].iloc[-1], panel.own["success"].max()
    return (
        f"Success of {panel.title} on {backend} over environment steps, {kind}: ends at {last:.2f}, "
        f"at most {most:.2f}, {int(panel.own['seeds'].iloc[0])} seeds."
    )


HOW = (
    "Line: median of the seeds' deterministic success over full episodes from stage 1. Dark band: its exact 95% "
    "interval at each step, which six seeds are needed for. Light band: from the worst seed to the best, which holds a "
    "share of all seeds with 95% confidence: 34% for five seeds, 61% for ten. Grey: the other methods. A run that "
    "stopped early goes on at its last value."
)


def section(source: Source) -> Section:
    """Success over the steps of training."""
    blocks = [found.block() for found in multiples(source, with_discovery=False)]
    return Section("curves", "Success over training", HOW, blocks or [Note("No training run has finished.")])


def cost_section(source: Source) -> Section:
    """Success over all steps, those of the discovery included."""
    if not has_price(source):
        note = Note("No finished method paid for a discovery here: the curves above are the whole price.")
        return Section("cost", "Success over all steps, discovery included", "", [note])
    lead = (
        "The same curves with the price of the causal graph before them. A graph that several seeds share is charged "
        "to each of them. Steps of the oracle and of a control's solvability test are truth, not price."
    )
    blocks = [found.block() for found in multiples(source, with_discovery=True)]
    return Section("cost", "Success over all steps, discovery included", lead, [*blocks, _price(source)])


def _price(source: Source) -> Table:
    names = ("backend", "method", "budget", "reached_90", "steps_to_90", "steps_to_90_with_discovery")
    columns = [column(name, numeric=name not in ("backend", "method")) for name in names]
    rows = [
        Row(
            [
                text(row["backend"]), text(entry(row)), number(row["budget"], 0), number(row["reached_90"], 0),
                steps(row, "steps_to_90"), steps(row, "steps_to_90_with_discovery"),
            ],
            row["backend"], row["method"],
        )
        for row in records(source.tables.leaderboard) if row["budget"] is not None
    ]  # fmt: skip
    return Table("Steps to 90% success", columns, rows)


def has_price(source: Source) -> bool:
    """Whether any finished method paid for a discovery."""
    return bool((source.tables.results["discovery_env_steps"] > 0).any())
