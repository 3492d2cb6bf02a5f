"""docs/plugins.md: the plugin in it, installed from an empty folder, keeps the contract."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
OUTCOMES = {"pass": 37, "not applicable": 10}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tutorial's files, and in `site` the plugin as pip installs it."""
    folder = tmp_path_factory.mktemp("floating")
    text = (DOCS / "plugins.md").read_text()
    blocks = re.findall(r"^`([\w.]+)`:\n\n```\w+\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert [name for name, _ in blocks] == ["pyproject.toml", "causalbench_floating.py", "test_floating.py"]
    for name, content in blocks:
        (folder / name).write_text(content)
    options = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check"]
    pip = [sys.executable, "-m", "pip", "install", *options, "--target", str(folder / "site"), str(folder)]
    subprocess.run(pip, check=True, capture_output=True, text=True)
    return folder


def call(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(filter(None, [str(folder / "site"), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, cwd=folder, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True)


def test_the_command_finds_and_passes_it(folder: Path) -> None:
    assert "causalbench-floating" in call(folder, "causalbench", "backends").stdout
    done = call(folder, "causalbench", "check", "floating", "--json")
    checks = json.loads(done.stdout)["checks"]
    assert [check for check in checks if check["outcome"] == "fail"] == []
    assert done.returncode == 0
    for outcome, count in OUTCOMES.items():
        assert sum(check["outcome"] == outcome for check in checks) == count


def test_its_own_test_passes(folder: Path) -> None:
    done = call(folder, "pytest", "-q", "-p", "no:cacheprovider", "test_floating.py")
    assert f"{OUTCOMES['pass']} passed, {OUTCOMES['not applicable']} skipped" in done.stdout, done.stdout
    assert done.returncode == 0
