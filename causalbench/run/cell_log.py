"""`log.txt` of a cell: all that its process prints goes there, from C, too, and it is kept in bounds."""

from __future__ import annotations

import os
from pathlib import Path

from causalbench.atomic import write_bytes
from causalbench.store.files import is_file

LIMIT = 4_000_000
"""Bytes that a log has at most once its cell has ended: half from its beginning, half from its end."""
LIMIT_WHILE_WRITTEN = 4 * LIMIT
INTERVAL = 5.0  # s between two looks at the logs that are being written


def print_to(path: Path) -> None:
    """Let this process, and what it starts, print to the end of the file `path`."""
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)


def cut(path: Path) -> None:
    """Leave the beginning alone of a log that has become too long while others append to it, who go on there."""
    if is_file(path) and path.stat().st_size > LIMIT_WHILE_WRITTEN:
        os.truncate(path, LIMIT // 2)


def shorten(path: Path) -> None:
    """Leave the beginning and the end of a log that is too long and that nobody writes to any more."""
    if not is_file(path) or (size := path.stat().st_size) <= LIMIT:
        return
    half = LIMIT // 2
    with path.open("rb") as file:
        beginning = file.read(half)
        file.seek(size - half)
        end = file.read()
    write_bytes(path, beginning + f"\n[{size - LIMIT} bytes are left out here]\n".encode() + end)
