"""The example of a stranger's discoverer, as a stranger installs and uses it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from installing import call, imports_of_causalbench
from truth import TRUTH

EXAMPLE = Path(__file__).parents[1] / "examples" / "a_discoverer"
MODULE = EXAMPLE / "causalbench_rank_correlation.py"


def test_it_imports_from_causalbench_what_its_facade_offers() -> None:
    assert imports_of_causalbench(MODULE) == {"causalbench.discoverer"}


@pytest.mark.long
def test_it_finds_what_moves_a_reward_and_shows_by_which_number(site: Path, tmp_path: Path) -> None:
    out = tmp_path / "found"
    options = ("--set", "threshold=0.15", "--set", "training_count=1000", "--out", str(out))
    done = call(tmp_path, site, "causalbench", "discover", "--discoverer", "rank_correlation", *options)
    assert done.returncode == 0, done.stderr
    (cell,) = (out / "discovery").iterdir()
    table = pd.read_csv(cell / "evidence.csv")
    assert list(table.columns) == ["stage", "term", "action", "outcome", "selected", "in_policy", "correlation"]
    np.testing.assert_array_equal(table["selected"] == 1, table["correlation"] > 0.15)
    found = table[(table["selected"] == 1) & (table["stage"] == 1)].groupby("term")["action"].agg(set)
    assert (found["r_eefx"], found["r_eefy"]) == (TRUTH[1]["r_eefx"], TRUTH[1]["r_eefy"])
    settings = json.loads((cell / "graph.json").read_text())["provenance"]["settings"]
    assert (settings["discoverer"], settings["options"]) == ("rank_correlation", {"threshold": 0.15})
    assert {path.stem for path in (cell / "figures").iterdir()} == {"evidence", "matrix", "graph"}


SUITE = """\
schema: 1
name: ranked
task: pure_manipulation
backends: [kinematic]
methods: []
tiers:
  smoke: {seeds: 1}
discovery: {discoverer: rank_correlation, training_count: 400, rank_correlation: {threshold: 0.15}}
"""


def test_a_suite_sets_its_setting_and_shows_its_evidence(site: Path, tmp_path: Path) -> None:
    (tmp_path / "ranked.yaml").write_text(SUITE)
    run = ("causalbench", "run", "ranked.yaml", "--tier", "smoke", "--out", "run", "--quiet")
    done = call(tmp_path, site, *run)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "run" / "discovery.csv")
    np.testing.assert_array_equal(table["selected"] == 1, table["correlation"] > 0.15)
    (cell,) = (tmp_path / "run" / "discovery").iterdir()
    assert (cell / "evidence.csv").exists()
    assert json.loads((cell / "cell.json").read_text())["settings"]["options"] == {"threshold": 0.15}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("threshold:", "treshold:", "discovery.rank_correlation.treshold: unknown key. Did you mean 'threshold'?"),
        ("0.15", "1.5", "discovery.rank_correlation.threshold: should be less than 1, got 1.5"),
    ],
)
def test_a_suite_that_mistakes_its_setting_is_refused_where_it_stands(
    site: Path, use_plugins: Callable, cli: Callable, tmp_path: Path, old: str, new: str, message: str
) -> None:
    use_plugins(site)
    (tmp_path / "ranked.yaml").write_text(SUITE.replace(old, new))
    done = cli("plan", "ranked.yaml", "--tier", "smoke")
    assert done.returncode == 2
    assert f"ranked.yaml:8: {message}" in done.stderr


def test_a_value_out_of_bounds_is_refused_on_the_command_line(site: Path, use_plugins: Callable, cli: Callable) -> None:
    use_plugins(site)
    for setting, message in (
        ("threshold=1.5", "--set threshold: should be less than 1, got 1.5"),
        ("training_count=many", "--set training_count: should be a valid integer, got 'many'"),
    ):
        done = cli("discover", "--discoverer", "rank_correlation", "--set", setting)
        assert done.returncode == 2
        assert message in done.stderr


def test_a_setting_that_it_does_not_have_is_refused_with_the_nearest(
    site: Path, use_plugins: Callable, cli: Callable
) -> None:
    use_plugins(site)
    done = cli("discover", "--discoverer", "rank_correlation", "--set", "treshold=0.15")
    assert done.returncode == 2
    assert "unknown setting of discoverer 'rank_correlation' 'treshold'. Did you mean 'threshold'?" in done.stderr
