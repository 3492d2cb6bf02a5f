"""Reading what causalbench wrote: regular files only, and every failure is a sentence that names the file.

A run folder may come from a stranger: a link in it is never followed, and no content is taken on trust.
"""

from __future__ import annotations

import functools
import json
import math
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn, TypeVar

import pydantic

from causalbench.digests import file_digest
from causalbench.errors import DamagedFileError

T = TypeVar("T")


def is_file(path: Path) -> bool:
    """Whether `path` is a regular file: no link, no folder, no pipe."""
    return _mode(path, stat.S_ISREG)


def is_folder(path: Path) -> bool:
    """Whether `path` is a folder and no link to one."""
    return _mode(path, stat.S_ISDIR)


def _mode(path: Path, test: Any) -> bool:
    try:
        return bool(test(path.lstat().st_mode))
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return False


def read_json(path: Path) -> dict[str, Any]:
    """The JSON object in the file `path`. Raises `DamagedFileError` when there is none."""
    check_file(path)
    try:
        content = json.loads(path.read_bytes(), parse_constant=_refuse, parse_float=_finite)
    except (OSError, ValueError, RecursionError) as error:
        raise DamagedFileError(f"{path}: not the JSON that was written ({error})") from error
    if not isinstance(content, dict):
        raise DamagedFileError(f"{path}: expected a JSON object, found {type(content).__name__}")
    return content


def validated(path: Path, type_: type[T], content: Any) -> T:
    """`content`, which was read from `path`, as a record; keys that it does not know are left out.

    Raises `DamagedFileError` that names the first key which is missing or has another type.
    """
    try:
        return _adapter(type_).validate_python(content)  # type: ignore[arg-type] # a type is hashable
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise DamagedFileError(f"{path}: {key}: {first['msg'].replace('Input should', 'should')}") from None


@functools.cache
def _adapter(type_: type[T]) -> pydantic.TypeAdapter[T]:
    return pydantic.TypeAdapter(type_)


def check_file(path: Path) -> None:
    """Raise `DamagedFileError` unless `path` is a regular file."""
    if not is_file(path):
        found = "missing" if not path.is_symlink() and not path.exists() else "a link or a folder, not a file"
        raise DamagedFileError(f"{path}: {found}")


def digests(folder: Path, leave_out: frozenset[str]) -> dict[str, str]:
    """Path below `folder` -> SHA-256 of every file in it; `leave_out` names files and folders directly in it."""
    return {str(path): file_digest(folder / path) for path in sorted(_files(folder, leave_out))}


def _files(folder: Path, leave_out: frozenset[str]) -> Iterator[PurePosixPath]:
    for path in folder.rglob("*"):  # which enters no link
        below = path.relative_to(folder)
        if below.parts[0] not in leave_out and is_file(path):
            yield PurePosixPath(below.as_posix())


def check_digests(folder: Path, files: Mapping[str, str]) -> None:
    """Raise `DamagedFileError` unless every file of `files` (path below `folder` -> SHA-256) is there, unchanged."""
    for name, expected in files.items():
        below = PurePosixPath(name)
        if below.is_absolute() or ".." in below.parts or not all(map(is_folder, _parents(folder, below))):
            raise DamagedFileError(f"{folder}: {name!r} is no file of this folder")
        if _digest(folder / below) != expected:
            raise DamagedFileError(f"{folder / below}: not the file that was written, its SHA-256 differs")


def _digest(path: Path) -> str:
    check_file(path)
    try:
        return file_digest(path)
    except OSError as error:
        raise DamagedFileError(f"{path}: cannot be read ({error.strerror})") from error


def _parents(folder: Path, below: PurePosixPath) -> Iterator[Path]:
    return (folder / parent for parent in below.parents if parent.parts)


def _finite(text: str) -> float:
    """The number; one that is too large would be infinite, which JSON cannot write."""
    if not math.isfinite(number := float(text)):
        _refuse(text)
    return number


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number")
