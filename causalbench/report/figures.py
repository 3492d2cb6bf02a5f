"""Pictures of a causal graph, as the paper has them: evidence as a heat map, causal matrix, graph beside the human's.

SVG (text stays text) and PNG, the same bytes for the same graph. matplotlib is imported when a picture is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from causalbench.atomic import write_folder
from causalbench.core.discovery.graph import CausalGraph, EvidenceColumn, StageGraph
from causalbench.report.drawing import STAGE_COLOURS, save, style
from causalbench.store.run_folder import RunFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

FRAME = "#D55E00"
UNTESTED: dict[str, Any] = {"facecolor": "#EEEEEE", "edgecolor": "#999999", "hatch": "///", "lw": 0}
INCH_PER_CELL = 0.62
FIGURES = "figures"
Column = tuple[StageGraph, int]


def write_figures(folder: Path, graph: CausalGraph, human: CausalGraph) -> None:
    """Fill `folder` with evidence, matrix and graph, as .svg and .png; `human` is the declared graph of the same task.

    A graph without a main column of evidence has no heat map.
    """
    drawings: dict[str, Callable[[], Figure]] = {
        "matrix": lambda: draw_matrix(graph),
        "graph": lambda: draw_graphs(graph, human),
    }
    if (main := graph.main_column) and any(main.name in stage.evidence for stage in graph.stages):
        drawings["evidence"] = lambda: draw_evidence(graph, main)

    def fill(path: Path) -> None:
        with style():
            for name, draw in drawings.items():
                save(draw(), path / name, f"{name} {graph.hash}")

    write_folder(folder, fill)


def write_discovery_figures(folder: Path) -> None:
    """Fill `figures/` in the folder of one discovery, from its graph.json and manual.json."""
    graph, human = (CausalGraph.load(folder / name) for name in ("graph.json", "manual.json"))
    write_figures(folder / FIGURES, graph, human)


def write_run_figures(run: RunFolder) -> None:
    """The same for every finished discovery of a run that has none yet."""
    for cell in run.cells():
        if cell.is_done("discovery") and not (cell.folder / FIGURES).exists():
            write_discovery_figures(cell.folder)


def draw_evidence(graph: CausalGraph, main: EvidenceColumn) -> Figure:
    """The column `main` of every (action, reward), selected cells framed, undecided ones with dots.

    Columns that could not be tested are hatched: their frames are the declared causes.
    """
    from matplotlib.patches import Patch

    columns, n_actions = _columns(graph), len(graph.stages[0].actions)
    nothing = np.full((n_actions, max(len(stage.terms) for stage in graph.stages)), np.nan)
    values = np.column_stack([stage.evidence.get(main.name, nothing)[:, j] for stage, j in columns])
    tested = np.array([_testable(stage, j, main) for stage, j in columns])
    figure, ax = _grid(graph, columns)
    image, extend = _heat_map(ax, np.where(tested, values, np.nan), main)
    _stage_lines(ax, columns)
    _frame_selected(ax, columns)
    bar = figure.colorbar(image, ax=ax, fraction=0.05, pad=0.03, shrink=0.9, extend=extend)
    bar.set_label(f"{main.name}, {main.unit}" if main.unit else main.name)
    keys = [Patch(facecolor="none", edgecolor=FRAME, lw=2.5, label="selected")]
    if any(stage.left_open.any() for stage in graph.stages):
        keys.append(Patch(facecolor="none", edgecolor=FRAME, lw=1.5, ls=":", label="undecided"))
    if not tested.all():
        keys.append(Patch(**UNTESTED, label="not testable: declared causes"))
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), frameon=False)
    return figure


def _heat_map(ax: Axes, values: NDArray[np.float64], main: EvidenceColumn) -> tuple[AxesImage, str]:
    """Paint and write every cell of `values` (n_actions, n_columns); a column of NaN is hatched."""
    from matplotlib.patches import Rectangle

    known = np.isfinite(values).all(0)
    norm, extend = _colours(values[:, known], main)
    shown = values.clip(norm.vmin)
    image = ax.imshow(shown, cmap="cividis", norm=norm, aspect="equal")
    for (row, column), value in np.ndenumerate(values):
        if known[column]:
            dark = norm(float(shown[row, column])) < 0.55
            ax.text(column, row, _short(float(value)), ha="center", va="center", fontsize=8, color="w" if dark else "k")
    for column in np.flatnonzero(~known):
        ax.add_patch(Rectangle((column - 0.5, -0.5), 1, len(values), **UNTESTED))
    return image, extend


def _frame_selected(ax: Axes, columns: list[Column]) -> None:
    from matplotlib.patches import Rectangle

    for column, (stage, j) in enumerate(columns):
        for row in np.flatnonzero(stage.matrix[:, j]):
            frame = Rectangle((column - 0.44, row - 0.44), 0.88, 0.88, fill=False, edgecolor=FRAME, lw=2.5)
            frame.set_gid(f"selected-{stage.stage}-{stage.terms[j]}-{stage.actions[row]}")
            ax.add_patch(frame)
        for row in np.flatnonzero(stage.left_open[:, j]):
            frame = Rectangle((column - 0.44, row - 0.44), 0.88, 0.88, fill=False, edgecolor=FRAME, lw=1.5, ls=":")
            frame.set_gid(f"undecided-{stage.stage}-{stage.terms[j]}-{stage.actions[row]}")
            ax.add_patch(frame)


def _colours(shown: NDArray[np.float64], main: EvidenceColumn) -> tuple[Normalize, str]:
    """How values become colours, and on which side of the bar there are values beyond it ("max" or "neither")."""
    from matplotlib.colors import LogNorm, Normalize

    if not shown.size:
        return Normalize(0.0, 1.0), "neither"
    largest = float(shown.max())
    if main.log_range is None:
        return Normalize(float(shown.min()), max(largest, float(shown.min()) + 1e-9), clip=True), "neither"
    # Colour ends there: a rare reward reaches numbers beside which every other cause would be pale.
    low, high = main.log_range
    end = min(max(largest, 10 * low), high)
    return LogNorm(low, end, clip=True), "max" if largest > end else "neither"


def draw_matrix(graph: CausalGraph) -> Figure:
    """The causal matrices of all stages in one, coloured by stage (paper, figure Causal Matrix); `?` is undecided."""
    from matplotlib.patches import Rectangle

    columns, actions = _columns(graph), graph.stages[0].actions
    figure, ax = _grid(graph, columns)
    for column, (stage, j) in enumerate(columns):
        for row in range(len(actions)):
            chosen = bool(stage.matrix[row, j])
            face = _colour(stage.stage) if chosen else "white"
            cell = Rectangle(
                (column - 0.5, row - 0.5), 1, 1, facecolor=face, edgecolor="#BBBBBB", lw=0.8, clip_on=False
            )
            if chosen:
                cell.set_gid(f"selected-{stage.stage}-{stage.terms[j]}-{actions[row]}")
            ax.add_patch(cell)
            said = "?" if stage.left_open[row, j] else str(int(chosen))
            ax.text(column, row, said, ha="center", va="center", color="k" if chosen else "#888888")
    _stage_lines(ax, columns)
    return figure


def draw_graphs(graph: CausalGraph, human: CausalGraph) -> Figure:
    """The graph and the human's side by side; edges of only one of them are dashed."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    titles = {"discovered": "discovered", "manual": "declared"}
    panels = [(titles[graph.origin], graph, human), ("a human's", human, graph)]
    actions, columns = graph.stages[0].actions, _columns(graph)
    height = 0.42 * max(len(actions), len(columns) + 0.6 * (len(graph.stages) - 1)) + 0.4
    widest = max(map(len, (*actions, *(stage.terms[j] for stage, j in columns))))
    figure = Figure(figsize=(2 * (3.6 + 0.14 * widest), height), layout="constrained")
    for ax, (title, own, other) in zip(figure.subplots(1, 2), panels, strict=True):
        _draw_graph(ax, own, other)
        ax.set_title(title)
    keys = [
        *(Line2D([], [], color=_colour(s.stage), lw=2, label=f"stage {s.stage}") for s in graph.stages),
        Line2D([], [], color="#444444", lw=2, ls=(0, (3, 2)), label="only in this one of the two"),
    ]
    figure.legend(handles=keys, loc="outside lower center", ncols=min(len(keys), 5), frameon=False)
    return figure


def _draw_graph(ax: Axes, graph: CausalGraph, other: CausalGraph) -> None:
    columns, actions = _columns(graph), graph.stages[0].actions
    heights = [float(i + 0.6 * (stage.stage - 1)) for i, (stage, _) in enumerate(columns)]
    total = max(heights[-1], len(actions) - 1.0)
    terms_y = [y + (total - heights[-1]) / 2 for y in heights]
    actions_y = np.linspace(0.0, total, len(actions)) if len(actions) > 1 else np.array([total / 2])
    for (stage, j), y in zip(columns, terms_y, strict=True):
        theirs = other.stages[stage.stage - 1].matrix[:, j]
        for row in np.flatnonzero(stage.matrix[:, j]):
            (line,) = ax.plot(
                [0, 1], [actions_y[row], y], color=_colour(stage.stage), lw=2,
                ls="-" if theirs[row] else (0, (3, 2)), zorder=1,
            )  # fmt: skip
            line.set_gid(f"edge-{stage.stage}-{stage.terms[j]}-{actions[row]}")
        ax.plot(1, y, "s", color=_colour(stage.stage), ms=9, mec="k", mew=0.8)
        ax.text(1.06, y, stage.terms[j], va="center", ha="left")
    used = np.any([stage.matrix.any(1) for stage in graph.stages], axis=0)
    for row, (action, y) in enumerate(zip(actions, actions_y, strict=True)):
        ax.plot(0, y, "o", color="#444444" if used[row] else "white", ms=9, mec="k", mew=0.8)
        ax.text(-0.06, y, action, va="center", ha="right")
    ax.set_xlim(-0.15, 1.15)
    ax.set_ylim(total + 0.6, -0.6)
    ax.axis("off")


def _grid(graph: CausalGraph, columns: list[Column]) -> tuple[Figure, Axes]:
    """Axes with actions down the side, terms along the bottom and stages above, each in its colour."""
    from matplotlib.figure import Figure

    actions = graph.stages[0].actions
    longest = max(len(stage.terms[j]) for stage, j in columns)
    size = (
        INCH_PER_CELL * len(columns) + 1.6 + 0.09 * max(map(len, actions)),
        INCH_PER_CELL * len(actions) + 1.0 + 0.06 * longest,
    )
    figure = Figure(figsize=size, layout="constrained")
    ax = figure.subplots()
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(len(actions) - 0.5, -0.5)
    ax.set_aspect("equal")
    ax.set_yticks(range(len(actions)), actions)
    ax.set_xticks(range(len(columns)), [stage.terms[j] for stage, j in columns], rotation=40, ha="right")
    ax.tick_params(length=0)
    for spine in ax.spines.values():
        spine.set_visible(False)
    first = 0
    for stage in graph.stages:
        n = len(stage.terms)
        ax.plot([first - 0.42, first + n - 0.58], [-0.62] * 2, color=_colour(stage.stage), lw=5, clip_on=False)
        name = f"stage {stage.stage}" if n > 1 else f"st. {stage.stage}"
        ax.text(first + (n - 1) / 2, -0.78, name, ha="center", va="bottom")
        first += n
    return figure, ax


def _stage_lines(ax: Axes, columns: list[Column]) -> None:
    for column in range(1, len(columns)):
        if columns[column][0].stage != columns[column - 1][0].stage:
            ax.axvline(column - 0.5, color="k", lw=1.5)


def _columns(graph: CausalGraph) -> list[Column]:
    return [(stage, j) for stage in graph.stages for j in range(len(stage.terms))]


def _testable(stage: StageGraph, column: int, main: EvidenceColumn) -> bool:
    return main.name in stage.evidence and (stage.testable is None or bool(stage.testable[column]))


def _colour(stage: int) -> str:
    return STAGE_COLOURS[(stage - 1) % len(STAGE_COLOURS)]


def _short(value: float) -> str:
    """At most four characters and a sign, so that a number fits its cell."""
    if not math.isfinite(value):
        return "?"
    size, sign = abs(value), "-" if value < 0 else ""
    if size < 0.0095:
        return "<.01"
    return sign + (f"{size:.2f}".lstrip("0") if size < 0.995 else f"{size:.1f}" if size < 99.5 else f"{size:.0f}")
