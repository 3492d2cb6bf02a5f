"""How every picture of a run looks: one palette, one style, SVG and PNG. matplotlib is imported when one is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STAGE_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
"""Okabe and Ito's colours, which colour-blind readers tell apart; a seventh stage starts again."""
STYLE: dict[str, Any] = {
    "font.size": 10.0,
    "text.parse_math": False,  # a name with a dollar in it is a name
    "svg.fonttype": "none",
    "svg.hashsalt": "causalbench",
    "figure.dpi": 100.0,
    "savefig.dpi": 130.0,
    "axes.titlesize": 11.0,
    "figure.constrained_layout.w_pad": 0.12,  # inches
    "savefig.bbox": "tight",  # whatever the length of a name, nothing is cut off
}


@contextmanager
def style(**changes: Any) -> Iterator[None]:
    """matplotlib's own defaults with `STYLE` and `changes`, whatever a user's matplotlibrc says."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE | changes)  # type: ignore[arg-type]
        yield


def save(figure: Figure, path: Path, title: str) -> None:
    """Write `figure` as `path`.svg and `path`.png, the same bytes for the same figure."""
    if figure.get_layout_engine():
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, for both files
    figure.savefig(f"{path}.svg", metadata={"Date": None, "Title": title})
    figure.savefig(f"{path}.png", metadata={"Software": None})
