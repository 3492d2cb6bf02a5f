"""`causalbench new-backend`: what it writes is installed as a user would, keeps the contract and is clean."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from generated import ROOT, RUFF, written
from installing import call

from causalbench.conformance.suite import CHECKS
from causalbench.errors import UserError
from causalbench.scaffold import write_backend

OUTCOMES = {"pass": 40, "fail": 0, "not applicable": 14}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, command: list[str]) -> Path:
    """The generated package, and in `site` the plugin as pip installs it."""
    return written(command, "backend", "my_sim", "check", tmp_path_factory.mktemp("author"))


def test_it_passes_check_as_generated(folder: Path) -> None:
    done = call(folder, folder / "site", "causalbench", "check", "my_sim", "--json")
    checks = json.loads(done.stdout)["checks"]
    assert done.returncode == 0, [check for check in checks if check["outcome"] == "fail"]
    assert {name: sum(check["outcome"] == name for check in checks) for name in OUTCOMES} == OUTCOMES


@pytest.mark.long
def test_its_own_tests_are_the_contract(folder: Path) -> None:
    done = call(folder, folder / "site", "pytest", "-q", "-p", "no:cacheprovider", "-k", "s01 or s13 or s16 or s36")
    assert f"3 passed, 1 skipped, {len(CHECKS) - 4} deselected" in done.stdout, done.stdout


@pytest.mark.parametrize("name", ["x", "a_name_as_long_as_that_of_some_simulators"])
@pytest.mark.parametrize(
    "tool",
    [
        *RUFF,
        pytest.param(
            ("mypy", "--strict", "--follow-imports", "silent", "--cache-dir", os.devnull), marks=pytest.mark.long
        ),
    ],
    ids=["ruff check", "ruff format", "mypy"],
)
def test_it_is_clean_whatever_its_name(tool: tuple[str, ...], name: str, tmp_path: Path) -> None:
    folder = write_backend(name, tmp_path)
    # mypy does not see what pip installed editable.
    done = call(folder, folder, *tool, f"causalbench_{name}", MYPYPATH=str(ROOT))
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_marks_what_to_replace_in_the_order_of_the_contract(folder: Path) -> None:
    lines = (folder / "causalbench_my_sim" / "scene.py").read_text().splitlines()
    marks = [line.partition("REPLACE ")[2].partition(" (S") for line in lines if "REPLACE " in line]
    places = [(int(number), int(rest.split()[0].rstrip("):"))) for number, _, rest in marks if rest]
    assert [number for number, _ in places] == [1, 2, 3, 4, 5, 6]
    assert places == sorted(places, key=lambda place: place[1])


@pytest.mark.parametrize("name", ["My_sim", "my-sim", "1sim", "my__sim", "_sim", "class", "", "../sim"])
def test_a_bad_name_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="expected lower-case letters, digits and single underscores"):
        write_backend(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_taken_names_and_folders_are_refused(tmp_path: Path) -> None:
    for name in ("kinematic", "gymrob"):
        with pytest.raises(UserError, match=f"backend '{name}' is already installed here; choose another name"):
            write_backend(name, tmp_path)
    (tmp_path / "my_sim_backend").mkdir()
    with pytest.raises(UserError, match=r"my_sim_backend already exists; remove it, or choose another --out"):
        write_backend("my_sim", tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot be written \(Not a directory\)"):
        write_backend("my_sim", tmp_path / "file")
