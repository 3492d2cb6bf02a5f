"""The data dictionary: every column of every file of a run is in it, frames follow it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest

import causalbench
from causalbench.errors import RunFolderError
from causalbench.report.columns import COLUMNS, FURTHER, TABLES
from causalbench.store.beside import BESIDE


def header(path: Path) -> list[str]:
    return path.read_text().splitlines()[0].split(",")


def test_every_name_is_explained_once_and_every_explanation_is_of_a_column() -> None:
    assert {name for names in TABLES.values() for name in names} == COLUMNS.keys()
    assert all(len(set(names)) == len(names) for names in TABLES.values())
    assert all(column.sentence.endswith(".") for column in COLUMNS.values())


def test_a_run_has_these_files_with_these_columns_and_no_others(finished_run: Path) -> None:
    found = {pattern: sorted(finished_run.glob(pattern)) for pattern in TABLES}
    assert sorted(path for paths in found.values() for path in paths) == sorted(finished_run.rglob("*.csv"))
    for pattern, paths in found.items():
        assert paths or Path(pattern).name in BESIDE, pattern  # nobody asked for those
        for path in paths:
            names = header(path)
            assert tuple(names[: len(TABLES[pattern])]) == TABLES[pattern]
            assert len(names) == len(TABLES[pattern]) or pattern in FURTHER


@pytest.mark.parametrize("name", ["results", "curves", "returns", "stages", "discovery", "leaderboard", "timing"])
def test_frames_have_what_the_files_say_with_the_dtypes_of_the_dictionary(finished_run: Path, name: str) -> None:
    frame = getattr(causalbench.load_results(finished_run), name)
    written = pd.read_csv(finished_run / f"{name}.csv", dtype=str)
    assert list(frame.columns) == list(written.columns)
    assert len(frame) == len(written) > 0
    for column in set(frame.columns) & COLUMNS.keys():
        assert frame[column].dtype.name == COLUMNS[column].dtype
        read = str if COLUMNS[column].dtype == "string" else float
        assert frame[column].isna().tolist() == written[column].isna().tolist()
        assert list(map(read, frame[column].dropna())) == list(map(read, written[column].dropna()))


def test_a_folder_that_is_none_and_a_damaged_one_are_refused(finished_run: Path, tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="no cells here; give the folder"):
        causalbench.load_results(tmp_path)
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    progress = next(run.glob("cells/*/progress.csv"))
    progress.write_text(progress.read_text().replace("0", "1"))
    with pytest.raises(RunFolderError, match=r"progress\.csv: not the file that was written"):
        causalbench.load_results(run)
