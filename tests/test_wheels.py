"""Built wheels, without the checkout: what a person who installs causalbench has."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PLUGINS = ("mujoco_kit", "gymrob_backend", "pybullet_backend", "robosuite_backend")
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The five wheels, built from a copy of what git has, so that nothing is left in the checkout."""
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheels")
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True).stdout
    subprocess.run(["tar", "-x"], cwd=source, check=True, input=archive)
    projects = [source, *(source / "plugins" / name for name in PLUGINS)]
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", target)
    subprocess.run([*PIP, "wheel", *options, *projects], check=True, capture_output=True)
    return sorted(target.glob("*.whl"))


@pytest.fixture(scope="module")
def site(wheels: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheels as pip installs them, in a folder of their own."""
    folder = tmp_path_factory.mktemp("site")
    subprocess.run([*PIP, "install", "--no-deps", "--no-index", "--target", folder, *wheels], check=True)
    return folder


def call(site: Path, cwd: Path, *arguments: str) -> str:
    """What a command prints that finds causalbench in `site` alone, before any editable install."""
    environment = os.environ | {"PYTHONPATH": str(site)}
    done = subprocess.run([sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_kind_of_file_in_the_documentation_travels_with_the_wheel() -> None:
    """But for tables of numbers and for what makes the reference."""
    assigned = (node for node in ast.parse((ROOT / "setup.py").read_text()).body if isinstance(node, ast.Assign))
    trees = next(ast.literal_eval(node.value) for node in assigned if ast.unparse(node.targets[0]) == "TREES")
    there = {f"*{path.suffix}" for path in (ROOT / "docs").rglob("*") if path.is_file()}
    assert there - {"*.csv", "*.py", "*.pyc"} == set(trees["docs"])


@pytest.mark.long
def test_the_wheel_has_every_suite(wheels: list[Path]) -> None:
    assert len(wheels) == 1 + len(PLUGINS)
    (core,) = [path for path in wheels if path.name.startswith("causalbench_robotics-")]
    there = {name for name in zipfile.ZipFile(core).namelist() if name.startswith("causalbench/suites/")}
    assert there == {f"causalbench/suites/{path.name}" for path in ROOT.glob("suites/*.yaml")}


@pytest.mark.long
def test_the_documentation_is_in_the_wheel_and_its_links_lead_somewhere(site: Path, tmp_path: Path) -> None:
    shown = call(site, tmp_path, "-m", "causalbench", "--help")
    assert str(site / "causalbench" / "docs" / "index.md") in "".join(shown.split())
    pages = sorted((site / "causalbench" / "docs").rglob("*.md"))
    assert len(pages) == len(list((ROOT / "docs").rglob("*.md")))
    for page in pages:
        for target in re.findall(r"\]\(([^)\s#]+)[^)]*\)", page.read_text()):
            assert re.match("https?:", target) or target.endswith(".csv") or (page.parent / target).exists(), page


@pytest.mark.long
def test_the_commands_work_from_any_folder(site: Path, tmp_path: Path) -> None:
    where = call(site, tmp_path, "-c", "import causalbench; print(causalbench.__file__)")
    assert Path(where.strip()) == site / "causalbench" / "__init__.py"
    assert call(site, tmp_path, "-m", "causalbench", "--version").startswith("causalbench ")
    assert "pure_manipulation-" in call(site, tmp_path, "-m", "causalbench", "plan", "pure_manip", "--tier", "smoke")
    for backend in ("gymrob", "pybullet", "robosuite"):
        assert backend in call(site, tmp_path, "-m", "causalbench", "backends")
