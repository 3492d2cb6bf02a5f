"""The page as a whole: what is in it, that it asks for nothing, and that no text becomes markup."""

from __future__ import annotations

import base64
import csv
import hashlib
import html.parser
import io
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from stored import discovered, finished

from causalbench.errors import RunFolderError, UserError
from causalbench.report.html.page import SECTIONS, write_report
from causalbench.store.run_folder import RunFolder

ORDER = [
    "verdicts", "leaderboard", "curves", "stages", "causes", "cost", "controls", "transfer", "films", "failures",
    "provenance",
]  # fmt: skip
VOID = {"meta", "link", "input", "img", "br"}


class Reader(html.parser.HTMLParser):
    """Collects every tag with its attributes, the text, and whether tags are closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.open, self.wrong = "", [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def read(written: Path) -> Reader:
    reader = Reader()
    reader.feed(written.read_text(encoding="utf-8"))
    return reader


def test_sections_stand_in_their_order(read: Reader) -> None:
    assert [attrs["id"] for tag, attrs in read.tags if tag == "section"] == ORDER
    assert len(SECTIONS) == len(ORDER)
    assert not read.wrong
    assert not read.open


def test_the_page_asks_for_nothing(read: Reader, written: Path) -> None:
    for tag, attrs in read.tags:
        for name in ("src", "href", "xlink:href", "srcset", "action", "data", "poster"):
            target = attrs.get(name) or "#"
            assert target.startswith(("#", "data:")), (tag, name, target)
    assert not re.search(r"@import|url\((?!#)", written.read_text(encoding="utf-8"))
    assert written.stat().st_size < 2_000_000


def test_only_the_script_of_the_package_may_run(read: Reader, written: Path) -> None:
    script = re.findall(r"<script>(.*?)</script>", written.read_text(encoding="utf-8"), re.DOTALL)
    (policy,) = (str(attrs["content"]) for tag, attrs in read.tags if attrs.get("http-equiv"))
    assert f"'sha256-{base64.b64encode(hashlib.sha256(script[0].encode()).digest()).decode()}'" in policy
    assert policy.startswith("default-src 'none'")
    assert len(script) == sum(tag == "script" for tag, _ in read.tags) == 1
    assert not any(name.startswith("on") for _, attrs in read.tags for name in attrs)


@pytest.mark.parametrize("place", ["reason", "log", "grid point", "note", "command", "known gap", "suite"])
def test_what_a_stranger_wrote_is_text(read: Reader, place: str) -> None:
    hostile = "</script><script>boom()</script>"
    before = {
        "reason": "ended with ", "log": "before\n", "grid point": "learner.note=", "note": "stage 1: ",
        "command": "causalbench '", "known gap": "S9", "suite": '"',
    }[place]  # fmt: skip
    assert re.search(re.escape(before) + r"\s*" + re.escape(hostile), read.text)
    assert not any(tag == "img" for tag, _ in read.tags)
    assert "{{ 7*7 }}" in read.text


def test_ids_are_unique_and_every_picture_says_what_it_shows(read: Reader) -> None:
    ids = Counter(attrs["id"] for _, attrs in read.tags if attrs.get("id"))
    assert [name for name, n in ids.items() if n > 1] == []
    pictures = [attrs for tag, attrs in read.tags if tag == "svg"]
    assert len(pictures) > 10
    assert all(attrs["role"] == "img" and len(attrs["aria-label"] or "") > 20 for attrs in pictures)


def test_the_data_of_a_figure_is_a_link_away(read: Reader) -> None:
    links = {attrs["download"]: str(attrs["href"]) for tag, attrs in read.tags if tag == "a" and attrs.get("download")}
    assert {"curves-physical.csv", "stages-kinematic.csv", "results.csv", "discovery.csv"} <= links.keys()
    content = base64.b64decode(links["curves-physical.csv"].partition("base64,")[2]).decode()
    last = [row for row in csv.DictReader(io.StringIO(content)) if row["method"] == "cm"][-1]
    assert (last["env_steps"], last["seeds"]) == ("100", "5")
    assert float(last["success"]) == 0.9  # the middle one of 0.7 0.8 0.9 0.9 1.0
    assert float(last["least"]) == 0.7
    assert float(last["most"]) == 1.0


def test_figures_and_leaderboards_lie_beside_it(written: Path) -> None:
    found = {path.name for path in (written.parent / "figures").iterdir()}
    kinds = ("seeds", "curves", "stages", "transitions")
    names = {f"{kind}-{backend}" for kind in kinds for backend in ("kinematic", "physical")}
    assert found == {f"{name}.{kind}" for name in names for kind in ("svg", "png")}
    assert (written.parent / "leaderboard.md").read_text().startswith("| backend | rank |")
    assert r"\begin{tabular}" in (written.parent / "leaderboard.tex").read_text()


def test_damage_is_said_and_not_counted(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    for seed in range(2):
        finished(run, seed=seed)
    next(tmp_path.glob("cells/*-s0-*/progress.csv")).write_text("env_steps\n1\n")
    text = write_report(tmp_path).read_text(encoding="utf-8")
    assert "its SHA-256 differs" in text
    assert "1 of 2 started cells done" in text


def test_its_tables_are_those_of_the_cells_that_are_there(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    for seed in range(2):
        finished(run, seed=seed)
        write_report(tmp_path)
        assert len((tmp_path / "results.csv").read_text().splitlines()) == seed + 2


def test_a_folder_of_discoveries_alone_has_a_page(tmp_path: Path) -> None:
    discovered(RunFolder(tmp_path))
    text = write_report(tmp_path).read_text(encoding="utf-8")
    assert "This run trains nothing" in text
    assert "discovered and declared causes are the same" in text


def test_no_folder_of_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="no cells here"):
        write_report(tmp_path)


@pytest.mark.parametrize("out", [".", "nowhere/page.html"])
def test_a_page_that_cannot_be_written_is_a_sentence(tmp_path: Path, out: str) -> None:
    discovered(RunFolder(tmp_path))
    with pytest.raises(UserError, match=r"cannot be written \(.*\); choose another place with --out"):
        write_report(tmp_path, tmp_path / out)


def test_with_out_nothing_is_written_into_the_run_and_nothing_heavy_is_imported(
    shown_run: Path, tmp_path: Path
) -> None:
    before = sorted(shown_run.rglob("*"))
    script = (
        "import sys; from causalbench.report.html.page import write_report; print(write_report(*sys.argv[1:]), "
        "*{'torch', 'stable_baselines3', 'mujoco', 'pybullet', 'robosuite'} & set(sys.modules))"
    )
    page = tmp_path / "page.html"
    command = [sys.executable, "-c", script, shown_run, page]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(page)
    assert page.stat().st_size > 100_000
    assert sorted(shown_run.rglob("*")) == before
