"""Small multiples as a block of the page and as a file beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from causalbench.report.drawing import save, style
from causalbench.report.html.drawings import STYLE, Panel, inline, together
from causalbench.report.html.parts import Download, Picture, Pictures

REM_PER_INCH = 7.5


@dataclass(frozen=True)
class Multiples:
    """Panels of one backend; `alts` and `methods` go with them, `data` is what they show, `name` that of its files."""

    name: str
    title: str
    backend: str
    panels: Sequence[Panel]
    alts: Sequence[str]
    methods: Sequence[str]
    data: pd.DataFrame
    note: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)

    def block(self) -> Pictures:
        """The panels for the page."""
        pictures = [
            Picture(
                inline(panel, f"{self.name}-{i}", alt),
                alt,
                panel.title,
                self.backend,
                method,
                width=REM_PER_INCH * panel.size[0],
            )
            for i, (panel, alt, method) in enumerate(zip(self.panels, self.alts, self.methods, strict=True))
        ]
        csv = Download.csv(f"{self.name}.csv", self.data)
        return Pictures(self.title, pictures, self.note, self.keys, csv, self.backend)

    def write(self, folder: Path) -> None:
        """The same panels in one picture, as `folder`/`name`.svg and .png."""
        with style(**STYLE):
            save(together(self.panels), folder / self.name, f"{self.title}: {self.backend}")
