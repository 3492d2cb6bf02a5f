"""Suites by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from causalbench.errors import UnknownNameError
from causalbench.suite.shipped import find_suite

SUITES = sorted((Path(__file__).parents[2] / "suites").glob("*.yaml"))


@pytest.mark.parametrize("path", SUITES, ids=lambda path: path.stem)
def test_a_bare_name_is_the_suite_that_comes_along(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / path.stem).mkdir()  # a folder of that name is no suite
    assert find_suite(Path(path.stem)).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("given", ["pure_manip.yaml", "mine/pure_manip", "/nowhere/pure_manip.yaml"])
def test_what_is_no_bare_name_is_a_file(given: str) -> None:
    assert find_suite(Path(given)) == Path(given)


def test_a_file_without_an_ending_is_taken_before_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pure_manip").write_text("schema: 1")
    assert find_suite(Path("pure_manip")) == Path("pure_manip")


def test_an_unknown_name_says_which_there_are() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown suite 'pure_mani'. Did you mean 'pure_manip'\? Known: .*yaml"):
        find_suite(Path("pure_mani"))
