"""Which releases of a simulator a backend works with, checked before anything of it is imported."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata

from packaging.specifiers import SpecifierSet

from causalbench.errors import BrokenVersionError


def require(releases: Mapping[str, str]) -> None:
    """Check the installed releases of distributions, without importing them.

    `releases` maps the name of a distribution to the releases that are known to work, written as in a requirement:
    `{"mujoco": ">=3.3,<3.10"}`. A distribution that is not installed is left to the import that will miss it. Raises
    `BrokenVersionError`, which says how to repair it, for the first installed release outside its range.
    """
    for name, known_to_work in releases.items():
        try:
            installed = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
        if not SpecifierSet(known_to_work).contains(installed, prereleases=True):
            raise BrokenVersionError(
                f"this backend is not known to work with the installed {name} {installed}. "
                f'Repair: pip install "{name}{known_to_work}"'
            )
