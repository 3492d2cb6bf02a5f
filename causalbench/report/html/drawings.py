"""Small multiples: the same panel for every method of a backend, one by one in the page, together in a file."""

from __future__ import annotations

import io
import math
import textwrap
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from markupsafe import Markup

from causalbench.report.drawing import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1b1f24"
"""Lines and text; in the page they take the colour of its text, light or dark."""
SIZE, LEFT, BELOW = (2.7, 1.9), 0.5, 0.42  # inches: one panel, and what its labels take
ACROSS = 4  # panels side by side in a file
SVG, XLINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
REFERRED_TO = {f"{{{SVG}}}{name}" for name in ("clipPath", "path", "pattern", "linearGradient", "image")}
STYLE = {
    "text.color": INK, "axes.edgecolor": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.spines.top": False, "axes.spines.right": False, "font.size": 8.5, "axes.titlesize": 9.0,
    "savefig.bbox": "standard",
}  # fmt: skip

ElementTree.register_namespace("", SVG)
ElementTree.register_namespace("xlink", XLINK)


class Panel(Protocol):
    """One of several small multiples."""

    @property
    def title(self) -> str:
        """What it is of."""

    @property
    def size(self) -> tuple[float, float]:
        """Its width and height in inches."""

    @property
    def left(self) -> float:
        """Inches that what stands beside its axes takes."""

    def paint(self, ax: Axes) -> None:
        """Draw it."""


def together(panels: Sequence[Panel]) -> Figure:
    """All panels in one figure, each under its title. Call it, and save the figure, within `style`."""
    from matplotlib.figure import Figure

    across = min(len(panels), ACROSS)
    down = math.ceil(len(panels) / across)
    titles = [textwrap.wrap(panel.title, 30) for panel in panels]
    above = 0.1 + 0.15 * max(map(len, titles))
    width, height = panels[0].size
    figure = Figure(figsize=(width * across, (height + above) * down))
    for index, (panel, title) in enumerate(zip(panels, titles, strict=True)):
        x, y = width * (index % across), (height + above) * (down - 1 - index // across)
        _axes(figure, panel, x, y).set_title("\n".join(title))
    return figure


def inline(panel: Panel, name: str, label: str) -> Markup:
    """The panel alone as SVG for the page, without a ground, in the colours of the page."""
    from matplotlib.figure import Figure

    with style(**STYLE):
        figure = Figure(figsize=panel.size)
        _axes(figure, panel, 0.0, 0.0)
        return embedded(figure, name, label)


def _axes(figure: Figure, panel: Panel, x: float, y: float) -> Axes:
    """The painted panel, its lower left corner at (x, y) inches: no layout is searched for, which takes longest."""
    across, down = figure.get_size_inches()
    width, height = panel.size
    place = (x + panel.left, y + BELOW, width - panel.left - 0.14, height - BELOW - 0.08)
    ax = figure.add_axes((place[0] / across, place[1] / down, place[2] / across, place[3] / down))
    panel.paint(ax)
    return ax


def embedded(figure: Figure, name: str, label: str, transparent: bool = True) -> Markup:
    """`figure` as SVG to stand in HTML; `name` keeps its ids apart from those of others, `label` is its alt text."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", transparent=transparent, metadata={"Date": None})
    root = ElementTree.fromstring(buffer.getvalue())
    for part in root.findall(f"{{{SVG}}}metadata"):
        root.remove(part)
    for part in root.findall(f"{{{SVG}}}defs[{{{SVG}}}style]"):
        root.remove(part)  # its rule stands in the page's style
    for size in ("width", "height"):
        root.attrib.pop(size, None)
    root.attrib |= {"role": "img", "aria-label": label}
    text = ElementTree.tostring(_own_ids(root, name), encoding="unicode")
    return Markup(text.replace(INK, "currentColor"))


def _own_ids(root: ElementTree.Element, name: str) -> ElementTree.Element:
    """Ids that the picture itself refers to begin with `name`, the others go: a page has many pictures."""
    for part in root.iter():
        for key, value in [*part.attrib.items()]:
            if key == "id" and part.tag in REFERRED_TO:
                part.set(key, f"{name}-{value}")
            elif key == "id":
                del part.attrib[key]
            elif key == f"{{{XLINK}}}href":
                part.set(key, value.replace("#", f"#{name}-", 1))
            elif "url(#" in value:
                part.set(key, value.replace("url(#", f"url(#{name}-"))
    return root
