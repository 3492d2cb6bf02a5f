"""Where the documentation lies: in the wheel `causalbench/docs/`, in a checkout `docs/`."""

from __future__ import annotations

from pathlib import Path

PACKAGE = Path(__file__).parent
TOP = PACKAGE if (PACKAGE / "docs").is_dir() else PACKAGE.parent
"""The folder that has `docs`, `suites` and `examples`."""


def page(name: str) -> Path:
    """The page `name` of the documentation, such as "how-to/suite.md"."""
    return TOP / "docs" / name
