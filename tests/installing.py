"""Installs a plugin's folder with pip, as its author would, without touching the environment of the tests."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

OPTIONS = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check"]


def install(folder: Path, site: Path) -> None:
    """Install the distribution in `folder` into the empty folder `site`."""
    pip = [sys.executable, "-m", "pip", "install", *OPTIONS, "--target", str(site), str(folder)]
    subprocess.run(pip, check=True, capture_output=True, text=True)


def call(cwd: Path, site: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the module that `arguments` name in a new process that finds what is installed in `site`."""
    path = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    environment = os.environ | {"PYTHONPATH": path} | environment
    return subprocess.run([sys.executable, "-m", *arguments], cwd=cwd, env=environment, capture_output=True, text=True)


def imports_of_causalbench(*modules: Path) -> set[str]:
    """The modules of causalbench that the files `modules` import names from."""
    nodes = [node for path in modules for node in ast.walk(ast.parse(path.read_text()))]
    found = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name for name in found if name.partition(".")[0] == "causalbench"}
