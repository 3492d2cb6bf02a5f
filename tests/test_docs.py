"""The documentation: links lead somewhere, files that it names exist, the index of decisions is complete."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/**/*.md", "examples/**/*.md", "plugins/*/*.md", "studies/**/*.md")
    for path in ROOT.glob(pattern)
)
PACKAGE_PATH = re.compile(r"`((?:core|suite|store|run|report|plugins|cli)/[\w/]+\.py)`")


def anchors(page: Path) -> set[str]:
    """What GitHub calls the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:", target):
            continue
        name, _, anchor = unquote(target).partition("#")
        there = (page.parent / name).resolve() if name else page
        if not there.exists() or (anchor and there.suffix == ".md" and anchor not in anchors(there)):
            broken.append(target)
    assert not broken


def test_files_that_the_architecture_names_exist() -> None:
    named = PACKAGE_PATH.findall((ROOT / "docs/architecture.md").read_text())
    assert len(named) > 15
    assert [name for name in named if not (ROOT / "causalbench" / name).is_file()] == []


def test_every_decision_is_in_the_index_once() -> None:
    folder = ROOT / "docs/decisions"
    listed = re.findall(r"\((\d{4}-[^)]+\.md)\)", (folder / "README.md").read_text())
    assert sorted(listed) == sorted(path.name for path in folder.glob("0*.md"))


def test_the_citation_names_the_version() -> None:
    from causalbench._version import __version__

    assert f"version: {__version__}\n" in (ROOT / "CITATION.cff").read_text()
