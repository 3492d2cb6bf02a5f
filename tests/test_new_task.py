"""`causalbench new-task`: what it writes is installed as a user would, keeps the contract and is clean."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from generated import RUFF, written
from installing import call

from causalbench.errors import UserError
from causalbench.scaffold import write_task

NOT_APPLICABLE = {"T3", "T18", "T21", "T22", "T26"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, command: list[str]) -> Path:
    """The generated package, and in `site` the plugin as pip installs it."""
    return written(command, "task", "my_task", "check --task", tmp_path_factory.mktemp("author"))


def test_it_passes_check_as_generated(folder: Path) -> None:
    done = call(folder, folder / "site", "causalbench", "check", "--task", "my_task", "--json")
    checks = json.loads(done.stdout)["checks"]
    assert {c["number"]: c["message"] for c in checks if c["outcome"] == "fail"} == {}
    assert {c["number"] for c in checks if c["outcome"] == "not applicable"} == NOT_APPLICABLE


def test_its_own_tests_are_the_contract(folder: Path) -> None:
    done = call(folder, folder / "site", "pytest", "-q", "-p", "no:cacheprovider", "-k", "t05 or t08 or t21")
    assert "2 passed, 1 skipped" in done.stdout, done.stdout


@pytest.mark.parametrize("name", ["x", "a_name_as_long_as_that_of_some_tasks"])
@pytest.mark.parametrize("tool", RUFF, ids=["ruff check", "ruff format"])
def test_it_is_clean_whatever_its_name(tool: tuple[str, ...], name: str, tmp_path: Path) -> None:
    folder = write_task(name, tmp_path)
    done = call(folder, folder, *tool, f"causalbench_{name}")
    assert done.returncode == 0, done.stdout + done.stderr


def test_bad_and_taken_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"task name 'My-task': expected lower-case letters.*such as my_task"):
        write_task("My-task", tmp_path)
    with pytest.raises(UserError, match="task 'pure_manipulation' is already installed here; choose another name"):
        write_task("pure_manipulation", tmp_path)
