"""Stage traces as a table, and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from stored import episode

from causalbench.errors import DamagedFileError
from causalbench.store.episodes import read_episodes, run_lengths, stage_trace, write_episodes


@pytest.mark.parametrize("seed", range(3))
def test_a_trace_comes_back(seed: int) -> None:
    stages = tuple(map(int, np.random.default_rng(seed).integers(1, 4, size=50)))
    assert stage_trace(run_lengths(stages)) == stages
    assert run_lengths((1, 1, 2, 1)) == "1x2 2x1 1x1"


@pytest.mark.parametrize("text", ["", "1", "1x", "0x3", "1x0", "1x2,2x1", "1x2  2x1", "1x-1", "a1x2"])
def test_what_is_no_trace_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no stage trace such as"):
        stage_trace(text)


@pytest.mark.parametrize("text", ["1x1000001", "1x999999 2x2", f"1x{'9' * 5000}"])
def test_a_trace_that_would_fill_the_memory_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"limit|more than 1000000 steps"):
        stage_trace(text)


def test_episodes_come_back_bit_for_bit_and_pandas_reads_them(tmp_path: Path) -> None:
    played = [
        episode("1x3 2x5 1x2 3x1", 4, held=True, returns={"r_a": 1 / 3, "r_b": -1e-17}),
        episode("1x20", 1, episode=1, deterministic=False, returns={"r_a": 0.1 + 0.2, "r_b": 0.0}),
        episode("1x2 2x2", 4, held=False, episode=2, returns={"r_a": 1.0, "r_b": 2.0}),
    ]
    write_episodes(tmp_path / "episodes.csv", played)
    assert read_episodes(tmp_path / "episodes.csv") == played
    table = pd.read_csv(tmp_path / "episodes.csv")
    assert table["stages"].tolist() == ["1x3 2x5 1x2 3x1", "1x20", "1x2 2x2"]
    assert table[["success", "deterministic", "length", "reversals", "final_stage"]].to_numpy().tolist() == [
        [1, 1, 11, 1, 4], [0, 0, 20, 0, 1], [1, 1, 4, 0, 4]
    ]  # fmt: skip
    assert table["held"].tolist()[::2] == [1.0, 0.0]
    assert np.isnan(table["held"][1])
    assert table["return"][2] == table["return_r_a"][2] + table["return_r_b"][2] == 3.0


def test_a_learner_may_keep_none(tmp_path: Path) -> None:
    write_episodes(tmp_path / "episodes.csv", [])
    assert read_episodes(tmp_path / "episodes.csv") == []


@pytest.mark.parametrize("content", ["", "a,b\n", "episode,success\n1,1\n", "[1]"])
def test_what_is_no_such_table_is_named(content: str, tmp_path: Path) -> None:
    path = tmp_path / "episodes.csv"
    path.write_text(content)
    with pytest.raises(DamagedFileError, match=f"^{path}: "):
        read_episodes(path)
