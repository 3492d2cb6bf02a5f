"""The files of a cell as records, and back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.errors import DamagedFileError
from causalbench.store.records import (
    read_counts,
    read_effects,
    read_progress,
    write_counts,
    write_progress,
    write_rows,
)


def test_evaluations_and_counts_come_back_bit_for_bit(tmp_path: Path) -> None:
    evaluations = [
        Evaluation(10, 3, 1 / 3, 0.1 + 0.2, None, 0.0, 1.5, 7.0, {"r_a": -1e-17, "r_b": 2.0}),
        Evaluation(20, 3, 1.0, 2 / 3, 0.5, 1.0, 4.0, 9.0, {"r_a": 3.0, "r_b": float(np.float32(0.1))}),
    ]
    write_progress(tmp_path / "progress.csv", evaluations)
    assert read_progress(tmp_path / "progress.csv") == evaluations
    table = np.zeros((3, 3), dtype=np.int64)
    table[1, 2], table[2, 1] = 4, 1
    write_counts(tmp_path / "counts.json", TrainingCounts(table, 20, 2, reversals=1, reached={1: 2, 2: 1}), None)
    counts = read_counts(tmp_path / "counts.json")
    assert [tuple(row) for row in counts.transitions] == [(1, 2, 4), (2, 1, 1)]
    assert (counts.env_steps, counts.reversals, counts.graph, counts.reached) == (20, 1, "", {"1": 2, "2": 1})


@pytest.mark.parametrize("read", [read_progress, read_effects, read_counts])
@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00", b"a,b\n1\n", b"env_steps\n", b"[1]", b"{}", b'{"env_steps": NaN}', b"[" * 10**5]
)
def test_what_is_no_such_file_is_named(read: Callable[[Path], Any], content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(DamagedFileError, match=f"^{path}: "):
        read(path)


def test_text_is_no_formula_to_a_spreadsheet_and_numbers_stay(tmp_path: Path) -> None:
    given = {
        "a": "=HYPERLINK(1)",
        "b": "@x",
        "c": "-1e-05",
        "d": -1.5,
        "e": "+cmd",
        "f": "plain",
        "g": None,
        "h": "-inf",
    }
    write_rows(tmp_path / "table.csv", list(given), [given])
    written = (tmp_path / "table.csv").read_text().splitlines()[1]
    assert written == "'=HYPERLINK(1),'@x,-1e-05,-1.5,'+cmd,plain,,-inf"
