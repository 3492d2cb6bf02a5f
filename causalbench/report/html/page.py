"""The page: sections in their order, put into the templates, and what is written beside it."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from os import PathLike
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from causalbench._version import __version__
from causalbench.atomic import write_folder, write_text
from causalbench.errors import UserError
from causalbench.report.figures import FIGURES
from causalbench.report.html import (
    board,
    causes,
    controls,
    curves,
    failures,
    films,
    flow,
    provenance,
    reversal,
    transfer,
    transitions,
    verdicts,
)
from causalbench.report.html.multiples import Multiples
from causalbench.report.html.source import Source, read_source
from causalbench.report.html.wording import count, listed
from causalbench.report.pastable import leaderboard_md, leaderboard_tex
from causalbench.report.tables import Table, write_found
from causalbench.store.run_folder import RunFolder

REPORT = "report.html"
SECTIONS = (
    verdicts.section, board.section, curves.section, reversal.section, causes.section, curves.cost_section,
    controls.section, transfer.section, films.section, failures.section, provenance.section,
)  # fmt: skip
"""What the page says, in its order."""


@dataclass(frozen=True)
class Fact:
    """A line at the top of the page; `tone` "warn" is one that a reader must not miss."""

    text: str
    tone: str = ""


def write_report(folder: str | PathLike[str], out: str | PathLike[str] | None = None) -> Path:
    """Write `report.html` into the run folder `folder`, with figures/, leaderboard.md and leaderboard.tex beside it.

    The tables of the folder are made again from its cells, which may have been copied there from several machines. With
    `out` only the page is written, to this path. It needs the folder alone: no torch, no simulator, no network.
    Returns the path of the page. Raises `RunFolderError` for a folder without cells, and `UserError` if the page cannot
    be written.
    """
    source = read_source(Path(folder))
    path = Path(out) if out else source.run.path / REPORT
    try:
        write_text(path, render(source))
        if out is None:
            write_found(source.run, source.found)
            write_beside(source)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror}); choose another place with --out") from error
    return path


def write_page(run: RunFolder, found: Mapping[str, Table]) -> None:
    """Write `report.html` alone into `run`, whose tables are `found`: what a run ends with."""
    write_text(run.path / REPORT, render(read_source(run.path, found)))


def write_beside(source: Source) -> None:
    """What is to be pasted elsewhere: every figure as SVG and PNG, the leaderboard as Markdown and LaTeX."""
    folder, board_table = source.run.path, source.tables.leaderboard

    def fill(figures: Path) -> None:
        for found in all_multiples(source):
            found.write(figures)

    write_folder(folder / FIGURES, fill)
    write_text(folder / "leaderboard.md", leaderboard_md(board_table))
    write_text(folder / "leaderboard.tex", leaderboard_tex(board_table))


def all_multiples(source: Source) -> Iterator[Multiples]:
    """The figures of the page that are files, too; those of each causal graph lie with its discovery."""
    yield from board.multiples(source)
    yield from curves.multiples(source, with_discovery=False)
    yield from flow.multiples(source)
    yield from transitions.multiples(source)
    if curves.has_price(source):
        yield from curves.multiples(source, with_discovery=True)


def render(source: Source) -> str:
    """The page as HTML."""
    environment = Environment(
        loader=PackageLoader("causalbench.report.html"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    script, look = _package_file("page.js"), _package_file("style.css")
    return environment.get_template("page.html.j2").render(
        title=source.run.path.resolve().name,
        facts=facts(source),
        sections=[make(source) for make in SECTIONS],
        backends=source.backends,
        methods=source.methods,
        version=__version__,
        script=Markup(script),
        look=Markup(look),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _package_file(name: str) -> str:
    return (files("causalbench.report.html") / name).read_text(encoding="utf-8")


def facts(source: Source) -> list[Fact]:
    """What a reader should know before any number."""
    results = source.tables.results
    tasks = sorted({cell.task for cell in source.cells})
    found = [Fact(f"Task: {listed(tasks)}"), Fact(f"Backends: {listed(source.backends)}")]
    if source.methods:
        found.append(Fact(f"Methods: {listed(source.methods)}"))
    if not results.empty:
        seeds = results.groupby(["backend", "method", "grid_point"])["seed"].nunique()
        few = f"{seeds.min()} to {seeds.max()}" if seeds.min() < seeds.max() else str(seeds.max())
        found.append(Fact(f"Seeds: {few}", "warn" if seeds.min() < 5 else ""))
        found.append(Fact(f"Budget: {listed(f'{budget:,}' for budget in sorted(set(results['budget'])))} steps"))
    done = sum(cell.status.state == "done" for cell in source.cells)
    missing = len(source.cells) - done
    found.append(Fact(f"{done} of {count(len(source.cells), 'started cell')} done", "warn" if missing else "good"))
    if (source.tables.leaderboard["sources"] > 1).any():
        found.append(Fact("Several versions of the code", "warn"))
    if source.problems:
        found.append(Fact(f"{count(len(source.problems), 'damaged file')} not counted", "warn"))
    if "kinematic" in source.backends:
        found.append(Fact("kinematic is a floating hand in numpy, not physics", "warn"))
    return found
