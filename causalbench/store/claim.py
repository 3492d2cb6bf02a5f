"""Folders that causalbench writes into: made by it, for one purpose, held by one command at a time."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from filelock import FileLock, Timeout

from causalbench import formats
from causalbench.atomic import sweep, write_json
from causalbench.errors import DamagedFileError, RunFolderError
from causalbench.store.files import is_file, is_folder, read_json, validated

LOCK, MARKER, HOLDER = ".lock", "run.json", ".holder.json"
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
        write_json(folder / HOLDER, asdict(Holder(os.getpid(), socket.gethostname(), _now())))
        yield
    finally:
        with suppress(OSError):  # the folder may be gone
            (folder / HOLDER).unlink(missing_ok=True)
        lock.release()


@dataclass(frozen=True)
class Holder:
    """The command that holds a folder: its process, the machine, and when it began, UTC."""

    pid: int
    host: str
    began: str

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.began}"


def holder(folder: Path) -> Holder | None:
    """Who holds `folder` now; None if nobody does. One that was killed holds nothing; the answer is of this instant."""
    if not is_file(folder / LOCK):
        return None
    try:
        with FileLock(folder / LOCK).acquire(blocking=False):
            return None
    except Timeout:
        return _said_by_holder(folder)
    except OSError:  # a folder that only others may write to
        return _said_by_holder(folder) if is_file(folder / HOLDER) else None


def _said_by_holder(folder: Path) -> Holder:
    try:
        return validated(folder / HOLDER, Holder, read_json(folder / HOLDER))
    except DamagedFileError:  # not written yet
        return Holder(0, "an unknown machine", "just now")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


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
        who = _said_by_holder(folder)
        raise RunFolderError(
            f"{folder}: another command is running here ({who}); wait or choose another --out"
        ) from error
    return lock
