"""The generated pages of docs/reference: made of the code as it is, and whole."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

import causalbench
from causalbench.cli.app import app
from causalbench.store.contents import FILES

FOLDER = Path(__file__).parents[1] / "docs" / "reference"
PAGES = ("api", "cli", "files", "settings", "tables")


@pytest.fixture(scope="module")
def make() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_reference", FOLDER / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_these_are_the_pages(make: ModuleType) -> None:
    assert set(PAGES) == make.PAGES.keys() == {path.stem for path in FOLDER.glob("*.md")}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_what_the_code_says(name: str, make: ModuleType) -> None:
    assert (FOLDER / f"{name}.md").read_text() == make.PAGES[name](), "run: python docs/reference/make.py"


def test_every_public_name_command_and_setting_has_a_sentence() -> None:
    public = {"make_env", "discover", "train", "run_suite", "load_results", "load_policy", "load_graph"}
    public |= {"DiscoverySettings", "EvaluationSettings", "PPOSettings", "SACSettings"}
    assert public < set(causalbench.__all__)
    api, cli = (FOLDER / "api.md").read_text(), (FOLDER / "cli.md").read_text()
    assert [name for name in public if f"\n### {name}\n" not in api] == []
    assert cli.count("\n## causalbench ") == len(app.registered_commands)
    for page in PAGES:
        empty = [line for line in (FOLDER / f"{page}.md").read_text().splitlines() if line.endswith("|  |")]
        assert [line for line in empty if not line.startswith(("|  | value", "| file |", "| key |", "| name |"))] == []


def test_a_run_has_the_files_that_the_page_names_and_no_others(finished_run: Path) -> None:
    found = [path.relative_to(finished_run) for path in finished_run.rglob("*") if path.is_file()]
    assert [str(path) for path in found if not any(path.match(pattern) for pattern in FILES)] == []
    passing = ("progress.json", ".holder", "checkpoint")
    elsewhere = (*passing, "tensorboard", "videos", ".slurm", "*/reversals", "*/transfer", "leaderboard.")
    unseen = [pattern for pattern in FILES if not any(path.match(pattern) for path in found)]
    assert [pattern for pattern in unseen if not any(name in pattern for name in elsewhere)] == []
