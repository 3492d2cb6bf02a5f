"""What a page is made of: plain data, which the templates turn into HTML. Text is text; only pictures are markup."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import pandas as pd
from markupsafe import Markup

from causalbench.report.frames import records
from causalbench.store.records import csv_text


@dataclass(frozen=True)
class Download:
    """A file that the page carries."""

    name: str
    href: str

    @classmethod
    def csv(cls, name: str, frame: pd.DataFrame) -> Download:
        """`frame` as the CSV file `name`."""
        return cls(name, data_uri("text/csv", csv_text(list(map(str, frame.columns)), records(frame)).encode()))


def data_uri(mime: str, content: bytes) -> str:
    """`content` as a link that needs no other file."""
    return f"data:{mime};base64,{base64.b64encode(content).decode()}"


@dataclass(frozen=True)
class Value:
    """A cell of a table: its text, what it is sorted by (None: last), and a bar to draw: a share, its interval."""

    text: str
    order: float | str | None = None
    bar: tuple[float, float, float] | None = None  # low, value, high in [0, 1]
    mark: str = ""  # "warn" or "good"


@dataclass(frozen=True)
class Column:
    """A column of a table; `sentence` says what it is."""

    name: str
    sentence: str = ""
    numeric: bool = False


@dataclass(frozen=True)
class Row:
    """A row of a table, which the filters for backends and methods may hide; "" is not filtered by."""

    values: Sequence[Value]
    backend: str = ""
    method: str = ""


@dataclass(frozen=True)
class Table:
    """A table that can be sorted."""

    kind: ClassVar[str] = "table"
    title: str
    columns: Sequence[Column]
    rows: Sequence[Row]
    csv: Download | None = None

    def without_empty_columns(self) -> Table:
        """The table without columns of which no row says anything."""
        kept = [i for i in range(len(self.columns)) if any(row.values[i].order is not None for row in self.rows)]
        rows = [replace(row, values=[row.values[i] for i in kept]) for row in self.rows]
        return replace(self, columns=[self.columns[i] for i in kept], rows=rows)


@dataclass(frozen=True)
class Picture:
    """An SVG that says in `alt` what is to be seen in it, up to `width` rem wide; `paper` if on white ground."""

    svg: Markup
    alt: str
    title: str = ""
    backend: str = ""
    method: str = ""
    paper: bool = False
    width: float = 52.0


@dataclass(frozen=True)
class Pictures:
    """Small multiples under one title, with one scale."""

    kind: ClassVar[str] = "pictures"
    title: str
    pictures: Sequence[Picture]
    note: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)  # what a colour says -> colour
    csv: Download | None = None
    backend: str = ""


@dataclass(frozen=True)
class Square:
    """A cell of a matrix: `state` is both, found, human or neither; `more` is a word or two in small print."""

    state: str
    symbol: str
    more: str
    sentence: str


@dataclass(frozen=True)
class Matrix:
    """A causal matrix: rows are actions, columns the terms of all stages."""

    kind: ClassVar[str] = "matrix"
    title: str
    stages: Sequence[tuple[int, int]]  # stage, number of its terms
    terms: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Square]]]
    backend: str = ""
    note: str = ""


@dataclass(frozen=True)
class Downloads:
    """Files to take away."""

    kind: ClassVar[str] = "downloads"
    title: str
    files: Sequence[Download]


@dataclass(frozen=True)
class Note:
    """A paragraph; `tone` "warn" is one that a reader must not miss, "good" is good news."""

    kind: ClassVar[str] = "note"
    text: str
    tone: str = ""


@dataclass(frozen=True)
class Verdict:
    """What became of a hypothesis: a word or two, and the sentence that says it with its evidence."""

    kind: ClassVar[str] = "verdict"
    word: str
    sentence: str
    backend: str = ""


@dataclass(frozen=True)
class Stretch:
    """A stretch of a film in one stage: where it begins and how long it is in per cent, and its start in seconds."""

    name: str
    colour: str
    left: float
    width: float
    start: float


@dataclass(frozen=True)
class FilmBlock:
    """A film with the ribbon of its stages."""

    kind: ClassVar[str] = "film"
    title: str
    source: str
    ribbon: Sequence[Stretch]
    backend: str
    method: str


@dataclass(frozen=True)
class Text:
    """Text as it stands, such as a log."""

    kind: ClassVar[str] = "text"
    title: str
    text: str


@dataclass(frozen=True)
class Fold:
    """Blocks that are closed at first."""

    kind: ClassVar[str] = "fold"
    title: str
    blocks: Sequence[Any]


@dataclass(frozen=True)
class Section:
    """A section of the page; `lead` says how to read it."""

    id: str
    title: str
    lead: str
    blocks: Sequence[Any]
