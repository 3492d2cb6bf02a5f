"""Studies: their suites make plans, their analyses say what is known of the numbers that are committed."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from causalbench.plugins.manager import installed
from causalbench.report.edge_scores import edge_scores
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite

ROOT = Path(__file__).parents[1]
SUITES = sorted((ROOT / "studies").glob("*/suite*.yaml"))


@pytest.mark.parametrize("path", SUITES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_tier_of_a_study_makes_a_plan(path):
    file = load_suite(path, installed())
    for tier in file.suite.tiers:
        assert make_plan(file, tier, installed(), seeds=1).cells


def test_every_study_has_its_page_and_analysis_and_stands_in_the_index():
    index = (ROOT / "studies/README.md").read_text()
    for folder in {path.parent for path in SUITES}:
        assert (folder / "README.md").exists()
        assert (folder / "analysis.py").exists()
        assert f"]({folder.name}/README.md)" in index


def test_scores_of_edges_are_those_worked_out_by_hand():
    grades, selected = ["strong", "strong", "absent", "absent", "weak", "untestable"], [1, 0, 1, 0, 1, 1]
    edges = pd.DataFrame({"backend": "b", "seed": 0, "oracle_grade": grades, "selected": selected})
    (row,) = edge_scores(edges, ["backend"]).to_dict("records")
    assert (row["right"], row["missed"], row["false"], row["seeds"]) == (1, 1, 1, 1)
    assert (row["precision"], row["recall"], row["f1"]) == (0.5, 0.5, 0.5)
    nothing = edge_scores(edges[edges["selected"] == 0], ["backend"]).to_dict("records")[0]
    assert (nothing["precision"], nothing["recall"]) == (1.0, 0.0)


def script(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tuning_grid_is_decided_as_the_page_says():
    analysis = script(ROOT / "studies/tuning/analysis.py")
    grid = pd.read_csv(ROOT / "docs/data/tuning_grid.csv")
    start = ["log_std_init" if method.endswith("PPO") else "ent_coef_init" for method in grid["method"]]
    grid["grid_point"] = [
        f"learner.learning_rate={rate:g}, learner.{name}={value:g}"
        for rate, name, value in zip(grid["learning_rate"], start, grid["entropy_start"], strict=True)
    ]
    chosen = analysis.chosen(grid).set_index("method")["grid_point"]
    page = re.findall(
        r"^\| (\w+) \| ([\d.]+) \| (-?[\d.]+) \| (?:yes|no) \|",
        (ROOT / "docs/results/before_features.md").read_text(),
        re.M,
    )
    assert len(page) == 7
    for method, rate, value in page:
        assert f"learning_rate={float(rate):g}," in chosen[method]
        assert chosen[method].endswith(f"={float(value):g}")


def test_verdicts_keep_their_level_on_null_suites_where_a_bootstrap_does_not():
    study = script(ROOT / "studies/verdicts/null_suites.py")
    pool = study.pools()["methods that learn"]
    # Of 400 suites with a family error of 5% more than 32 have a verdict with a chance of 0.3%.
    assert study.family_error(pool, 400, 5, shared=0.0) <= 32 / 400
    decided, _ = study.until_decided(study.null_suites(pool, 200, 6, 0.0, np.random.default_rng(1)))
    assert decided.any(axis=1).mean() <= 20 / 200
    assert study.bootstrap_error(pool["gymrob"], 400, 5) > 0.08 > study.interval_error(pool["gymrob"], 400, 5)


def test_clear_cut_claims_are_found_and_take_half_of_ten_seeds():
    study = script(ROOT / "studies/verdicts/null_suites.py")
    assert study.power(50, 5).loc["cmSAC > mSAC", "all"] == 1
    decided, spent = study.until_decided(study.committed(50, 10, np.random.default_rng(1)), study.HYPOTHESES[:3])
    assert decided[:, ::3].all()
    assert spent.mean() <= 5


def test_every_committed_table_of_numbers_says_where_it_is_from():
    listed = re.findall(r"\]\((\w+\.csv)\)", (ROOT / "docs/data/README.md").read_text())
    assert sorted(listed) == sorted(path.name for path in (ROOT / "docs/data").glob("*.csv"))
