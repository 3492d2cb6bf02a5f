"""Atomic files: written under a temporary name, then moved, so that a reader sees the old content or the new.

What stands at the target is replaced, never written into: a link there is replaced by the file, and what it points to
stays as it is.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

TEMPORARY = ".causalbench-tmp"
"""What a temporary name has before its suffix; only a process that was killed while it wrote leaves such a path."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path to make a file at, which then replaces `path`; after an error that stays as it was.

    An `OSError` that names no file, as that of a full disk, gets the name of this one.
    """
    temporary = _temporary(path)
    remove(temporary)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Replace the file `path` by `text`, as a whole or not at all."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Replace the file `path` by `content`, as a whole or not at all."""
    with replacing(path) as temporary, temporary.open("xb") as file:
        file.write(content)


def write_json(path: Path, content: Any) -> None:
    """Replace the file `path` by `content`, indented, keys in the order given."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def write_folder(path: Path, fill: Callable[[Path], None]) -> None:
    """Make the folder `path` by `fill(temporary folder)`; it appears only when it is complete."""
    temporary = _temporary(path)
    remove(temporary)
    temporary.mkdir()
    fill(temporary)
    remove(path)
    os.replace(temporary, path)


def remove(path: Path) -> None:
    """Delete a file, a link (never what it points to) or a whole folder; nothing happens if there is none."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Delete what a killed process was writing into `folder`; folders inside it are not entered."""
    for path in [*folder.glob(f".*{TEMPORARY}*")]:
        remove(path)


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}{TEMPORARY}{path.suffix}")
