"""Every block of Python on the page with other libraries is a program that runs as it stands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
WHOLE = {"other_libraries.md"}
"""Pages whose blocks are whole programs; those of the others are pieces of examples, which have tests of their own."""


def blocks(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


PROGRAMS = [(page.stem, code) for page in PAGES if page.name in WHOLE for code in blocks(page)]


def test_the_page_with_other_libraries_has_a_program_for_each() -> None:
    imported = {name for _, code in PROGRAMS for name in re.findall(r"^(?:import|from) (\w+)", code, re.MULTILINE)}
    assert imported >= {"gymnasium", "stable_baselines3", "mo_gymnasium", "torch"}


@pytest.mark.parametrize(
    "code", [code for _, code in PROGRAMS], ids=[f"{name}-{i}" for i, (name, _) in enumerate(PROGRAMS)]
)
def test_a_program_runs_as_it_stands(code: str, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(code)
    env = os.environ | {"PYTHONWARNINGS": "default"}
    done = subprocess.run([sys.executable, "program.py"], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout
