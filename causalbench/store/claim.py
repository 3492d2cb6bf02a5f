"""Folders that causalbench writes into: made by it, for one purpose, held by one command at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from filelock import FileLock, Timeout

from causalbench import formats
from causalbench.atomic import sweep, write_json
from causalbench.errors import DamagedFileError, RunFolderError
from causalbench.store.files import is_file, is_folder, read_json

LOCK, MARKER = ".lock", "run.json"
Kind = Literal["run", "discovery"]
"""What a folder is for: all that a suite asks for, or the discovery of `causalbench discover`."""


@contextmanager
def claim(folder: Path, kind: Kind, known: bool = False) -> Iterator[None]:
    """Make `folder`, if it is not there, and hold it until the block ends; a killed process lets go of it.

    `known` says that the folder is ours although its marker may be damaged. Raises `RunFolderError` when the folder
    cannot be written, when another command holds it, or when it has content and causalbench did not make it for `kind`.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not known:
            _check_ours(folder, kind)
        lock = _lock(folder)
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written ({error.strerror}); choose another with --out") from error
    try:
        if not _is_marked(folder, kind):
            write_json(folder / MARKER, {"schema": formats.RUN, "kind": kind})
        sweep(folder)
        yield
    finally:
        lock.release()


def own_folder(path: Path) -> Path:
    """Make the folder `path` in one that is claimed, and return it. Raises `RunFolderError` if it is a link."""
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be made ({error.strerror}); delete what is there") from error
    if not is_folder(path):
        raise RunFolderError(f"{path}: a link, which is never followed; delete it, or choose another --out")
    return path


def _check_ours(folder: Path, kind: Kind) -> None:
    content = sorted(path.name for path in folder.iterdir() if path.name != LOCK)
    if content and not _is_marked(folder, kind):
        raise RunFolderError(
            f"{folder}: not empty ({content[0]!r} is there), and this version of causalbench did not make it "
            f"for a {kind}; choose another with --out"
        )


def _is_marked(folder: Path, kind: Kind) -> bool:
    try:
        return read_json(folder / MARKER) == {"schema": formats.RUN, "kind": kind}
    except DamagedFileError:
        return False


def _lock(folder: Path) -> FileLock:
    path = folder / LOCK
    if path.is_symlink() or (path.exists() and not is_file(path)):
        raise RunFolderError(f"{path}: not a lock of causalbench but a link or a folder; choose another with --out")
    lock = FileLock(path)
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        raise RunFolderError(f"{folder}: another command is running here; wait or choose another --out") from error
    return lock
