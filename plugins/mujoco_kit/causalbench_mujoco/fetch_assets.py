"""Where the robot files of Fetch are. Imports no simulator."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path


def fetch_assets() -> Path:
    """Folder of those that gymnasium-robotics installs.

    Looked up without the import, which prints warnings and costs a second. Raises `ModuleNotFoundError` without it.
    """
    spec = find_spec("gymnasium_robotics")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("gymnasium_robotics is not installed")
    return Path(spec.origin).parent / "envs" / "assets"
