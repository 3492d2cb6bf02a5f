"""Files of a cell with bytes changed at random: what is read back is a record or a sentence, and it takes no time."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causalbench.errors import DamagedFileError
from causalbench.store.cell_progress import read_cell_progress
from causalbench.store.cells import read_cell
from causalbench.store.episodes import read_episodes
from causalbench.store.records import read_counts, read_progress

READERS: dict[str, Callable[[Path], Any]] = {
    "progress.csv": read_progress,
    "episodes.csv": read_episodes,
    "counts.json": read_counts,
    "cell.json": lambda path: read_cell(path.parent),
    "status.json": lambda path: read_cell(path.parent),
    "progress.json": lambda path: read_cell_progress(path.parent),
}
HOSTILE = (
    b"\x00", b"\xff", b"1e999", b"-1", b"nan", b"Infinity", b"9" * 400, b"1x99999999", b'"', b",", b"\n", b"[[[[", b"{",
)  # fmt: skip
INPUTS = 60
"""For each file; 1,700 of each were read once, and three kinds of tracebacks mended."""


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """`content` with one to three pieces cut out, repeated or replaced by something hostile."""
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(0, len(content) + 1))
        end = min(len(content), at + int(rng.integers(0, 12)))
        piece = (b"", 3 * content[at:end], HOSTILE[rng.integers(len(HOSTILE))], rng.bytes(3))[rng.integers(4)]
        content = content[:at] + piece + content[end:]
    return content


def complaint(read: Callable[[Path], Any], path: Path) -> str | None:
    """What `read` says is wrong; None if it reads the file."""
    try:
        read(path)
    except DamagedFileError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", READERS)
def test_a_changed_file_is_read_or_named(name: str, finished_run: Path, tmp_path: Path) -> None:
    (cell,) = finished_run.glob("cells/*-mSAC-s0-*")
    folder = Path(shutil.copytree(cell, tmp_path / cell.name))
    (folder / "progress.json").write_text('{"fraction": 0.5, "seconds": 3.0, "began_at": 0.1, "text": "stage 1"}')
    path, rng = folder / name, np.random.default_rng(len(name))
    content = path.read_bytes()
    for _ in range(INPUTS):
        path.write_bytes(mutated(content, rng))
        said = complaint(READERS[name], path)
        assert said is None or str(path.parent) in said
