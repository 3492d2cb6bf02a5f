"""examples/hinge_arm_backend: installed as its author would, its own tests pass, and the tutorial quotes it rightly."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from installing import call

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "hinge_arm_backend"


@pytest.mark.parametrize(
    ("options", "outcome"),
    [
        (("-k", "s04 or s06 or s12 or s16"), "3 passed, 1 skipped, 50 deselected"),
        pytest.param((), "46 passed, 8 skipped", marks=pytest.mark.long),  # a base that drives
    ],
    ids=["a few lines", "all lines"],
)
def test_the_example_keeps_the_contract(options: tuple[str, ...], outcome: str, site: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(EXAMPLE, tmp_path / "hinge_arm_backend")  # away from this repository's conftest.py
    done = call(folder, site, "pytest", "-q", "-p", "no:cacheprovider", *options, "tests")
    assert re.search(rf"^{outcome}", done.stdout, re.MULTILINE), done.stdout


def test_the_tutorial_quotes_the_example() -> None:
    page = (ROOT / "docs" / "tutorial_backend.md").read_text().partition("## With an arm")[2]
    quotes = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    source = (EXAMPLE / "causalbench_hinge_arm" / "scene.py").read_text()
    assert len(quotes) == 3
    assert all(quote in source for quote in quotes[:2])
