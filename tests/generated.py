"""Packages that `causalbench new-...` writes: made and installed as a user would, and tools that must pass on them."""

from __future__ import annotations

import subprocess
import tomllib
from pathlib import Path

from installing import install

ROOT = Path(__file__).parents[1]
RULES = ",".join(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["ruff"]["lint"]["select"])
ISOLATED = ("--isolated", "--line-length", "120")
RUFF = (
    ("ruff", "check", *ISOLATED, "--select", RULES, "--ignore", "D107", "tests"),
    ("ruff", "format", *ISOLATED, "--check", "tests"),
)
"""The commands that find nothing to say about a generated package; its name follows."""


def written(command: list[str], kind: str, name: str, check: str, parent: Path) -> Path:
    """The folder of the package that `new-KIND NAME` wrote into `parent`, and in `site` the plugin as pip installs it.

    The command must end with how to install it and how to `check` it.
    """
    done = subprocess.run([*command, f"new-{kind}", name], cwd=parent, capture_output=True, text=True, check=True)
    folder = f"{name}_{kind}"
    assert done.stdout.startswith(f"wrote {folder}; now: pip install -e {folder} && causalbench {check} {name}")
    install(parent / folder, parent / folder / "site")
    return parent / folder
