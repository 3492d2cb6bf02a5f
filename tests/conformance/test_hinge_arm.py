"""examples/hinge_arm_backend: installed as its author would, its own tests pass, and the tutorial quotes it rightly."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from installing import call, install

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "hinge_arm_backend"


def test_the_example_keeps_the_contract(tmp_path: Path) -> None:
    folder = shutil.copytree(EXAMPLE, tmp_path / "hinge_arm_backend")  # away from this repository's conftest.py
    install(folder, tmp_path / "site")
    done = call(folder, tmp_path / "site", "pytest", "-q", "-p", "no:cacheprovider", "tests")
    assert re.search(r"^45 passed, 8 skipped", done.stdout, re.MULTILINE), done.stdout  # a base that drives


def test_the_tutorial_quotes_the_example() -> None:
    page = (ROOT / "docs" / "tutorial_backend.md").read_text().partition("## With an arm")[2]
    quotes = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    source = (EXAMPLE / "causalbench_hinge_arm" / "scene.py").read_text()
    assert len(quotes) == 3
    assert all(quote in source for quote in quotes[:2])
