"""Atomic files: written under a temporary name, then moved, so that a reader sees the old content or the new."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

TEMPORARY = ".*.tmp"
"""Pattern of the temporary names; such a path is left behind only by a process that was killed while it wrote."""


def write_text(path: Path, text: str) -> None:
    """Replace the file `path` by `text`, as a whole or not at all."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Replace the file `path` by `content`, as a whole or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def write_json(path: Path, content: Any) -> None:
    """Replace the file `path` by `content`, indented, keys in the order given."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def write_folder(path: Path, fill: Callable[[Path], None]) -> None:
    """Make the folder `path` by `fill(temporary folder)`; it appears only when it is complete."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    fill(temporary)
    shutil.rmtree(path, ignore_errors=True)
    os.replace(temporary, path)
