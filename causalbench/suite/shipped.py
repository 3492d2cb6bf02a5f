"""The suites that come with causalbench, by name: in the wheel `causalbench/suites/`, in a checkout `suites/`."""

from __future__ import annotations

from pathlib import Path

from causalbench.errors import UnknownNameError
from causalbench.pages import TOP


def shipped_suites() -> dict[str, Path]:
    """Name -> file of every suite that comes with causalbench."""
    return {path.stem: path for path in sorted((TOP / "suites").glob("*.yaml"))}


def find_suite(given: Path) -> Path:
    """The suite file that a person means: `given`, or for a bare name such as `pure_manip` the shipped one.

    Raises `UnknownNameError` for a bare name of neither.
    """
    if len(given.parts) != 1 or given.suffix or (given.exists() and not given.is_dir()):
        return given
    shipped = shipped_suites()
    if given.name not in shipped:
        raise UnknownNameError("suite", given.name, shipped, "A file of your own ends in .yaml.")
    return shipped[given.name]
