"""What the benchmarks share, and the pages that are made of what they measured."""

import importlib
import subprocess
import sys
from pathlib import Path

import discoveries
import learning_results
import numpy as np
import pages
import pandas as pd
import pytest
import tuning_grid

from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.pipeline import discover
from causalbench.core.discovery.samples.streams import Recipe
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.run.score_graph import judge_graph
from causalbench.store.samples import SampleFolder

ROOT = Path(__file__).parents[1]
PRESET = (1e-3, 0.05)  # of SAC
TINY = DiscoverySettings(training_count=64, options=KLSettings(max_epochs=1))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """(folder, graph, truth) of a tiny discovery with an oracle."""
    folder = tmp_path_factory.mktemp("made")
    graph = discover(TASK, make, TINY, 3, discoveries.quiet, store=SampleFolder(folder / "data"))
    graph, truth = judge_graph(graph, TASK, make, 40, 3, folder, discoveries.quiet)
    (folder / "graph.json").write_text(graph.to_json())
    return folder, graph, truth


def test_the_truth_is_read_as_it_was_found(made):
    folder, graph, truth = made
    for read, found in zip(discoveries.read_truth(folder), truth, strict=True):
        assert read.grades() == found.grades()
        np.testing.assert_allclose(read.effect, found.effect)
        np.testing.assert_allclose(read.floor, found.floor)
    scores = graph.oracle["scores"][-1]
    judged = discoveries.judged(graph, truth)
    assert (judged["f1"], judged["shd"]) == (scores["f1"], scores["shd"])
    assert len(judged["missed"].split()) + len(judged["false"].split()) == judged["shd"]


def test_decisions_on_kept_samples_are_those_of_the_discovery(made):
    folder, graph, _ = made
    store = SampleFolder(folder / "data")
    wholes = discoveries.stages_of(Recipe(TASK, TINY, 3, store.origin()[0], None, store))
    for again, stage in zip(discoveries.decide(wholes, TINY, 3).stages, graph.stages, strict=True):
        np.testing.assert_array_equal(again.evidence["kl"], stage.evidence["kl"])
        np.testing.assert_array_equal(again.matrix, stage.matrix)


def test_a_measurement_is_made_once(tmp_path):
    calls = []
    for _ in range(2):
        discoveries.measured(tmp_path / "a.csv", lambda: calls.append(1) or [{"x": 1}])
    assert calls == [1]
    pd.testing.assert_frame_equal(
        discoveries.put_together(tmp_path, "all", tmp_path / "docs", ("x",)), pd.DataFrame({"x": [1]})
    )


@pytest.mark.parametrize("page", ["discovery_results", "learning_results"])
def test_a_results_page_says_what_the_data_say(page):
    done = subprocess.run(
        [sys.executable, f"benchmarks/{page}.py", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("path", sorted((ROOT / "benchmarks").glob("discover*.py")), ids=lambda path: path.stem)
def test_every_discovery_benchmark_says_how_it_is_called(path):
    module = importlib.import_module(path.stem)
    assert f"python benchmarks/{path.name}" in module.__doc__
    assert callable(module.main)


def _grid(method, scores):
    """Rows of a tuning grid: point -> (success AUC, stage AUC) of seeds 20 and 21."""
    return pd.DataFrame(
        {
            "method": method,
            "learning_rate": rate,
            "entropy_start": start,
            "seed": seed,
            "success_auc": s,
            "stage_auc": t,
        }
        for (rate, start), of_seeds in scores.items()
        for seed, (s, t) in zip((20, 21), of_seeds, strict=True)
    )


@pytest.mark.parametrize(
    ("scores", "point"),
    [
        ([(0.5, 0.0), (0.5, 0.0), (0.5, 0.0), (0.1, 0.9)], PRESET),  # better on one seed alone
        ([(0.5, 0.0), (0.5, 0.0), (0.6, 0.0), (0.6, 0.0)], (3e-3, 0.2)),
        ([(0.0, 0.1), (0.0, 0.3), (0.0, 0.2), (0.0, 0.4)], (3e-3, 0.2)),  # no success: stages decide
        ([(0.5, 0.0), (0.5, 0.0), (0.5, 0.0), (0.5, 0.0)], PRESET),
    ],
)
def test_a_method_leaves_its_preset_only_for_what_is_better_on_every_seed(scores, point):
    grid = _grid("mSAC", {PRESET: scores[:2], (3e-3, 0.2): scores[2:]})
    (row,) = tuning_grid.chosen(grid).to_dict("records")
    assert (row["learning_rate"], row["entropy_start"]) == point
    assert row["preset"] == ("yes" if point == PRESET else "no")


def test_of_several_better_points_the_best_mean_is_taken():
    grid = _grid("mSAC", {PRESET: [(0, 0), (0, 0)], (3e-3, 0.2): [(0.1, 0), (0.9, 0)], (3e-4, 0.2): [(0.6, 0)] * 2})
    assert tuning_grid.chosen(grid)["learning_rate"].item() == 3e-4


def test_what_is_read_of_a_run_are_its_results_with_collisions_and_seconds(tmp_path):
    run, docs = tmp_path / "run", tmp_path / "docs"
    docs.mkdir()
    suite = tmp_path / "tiny.yaml"
    suite.write_text(
        "{schema: 1, name: tiny, task: mobile_manipulation, backends: [kinematic], methods: [mPPO],"
        " tiers: {smoke: {seeds: 1, env_steps: 60}}, learner: {n_steps: 30},"
        " evaluation: {every: 30, episodes: 1, final_episodes: 1}}"
    )
    subprocess.run([sys.executable, "-m", "causalbench", "run", suite, "--tier", "smoke", "--out", run], check=True)
    assert learning_results.read_run(run, docs) == "tiny"
    (row,) = pd.read_csv(docs / "tiny_results.csv").to_dict("records")
    (whole,) = pd.read_csv(run / "results.csv").to_dict("records")
    assert row.items() >= {key: whole[key] for key in ("method", "backend", "env_steps")}.items()
    assert row["collisions_per_episode"] == int(row["collisions_per_episode"])  # one episode: a whole number of steps
    assert row["seconds"] > 0
    assert len(pd.read_csv(docs / "tiny_curves.csv")) == 2


def test_what_is_not_measured_again_keeps_its_rows(tmp_path):
    old = pd.DataFrame({"task": "t", "backend": "b", "method": "m", "seed": [0, 1], "x": [1, 2]})
    old.to_csv(tmp_path / "x.csv", index=False)
    new = old.assign(seed=[1, 2], x=[3, 4])
    table = pages.merged(tmp_path / "x.csv", new, ("backend", "method", "seed"))
    assert table[["seed", "x"]].to_numpy().tolist() == [[0, 1], [1, 3], [2, 4]]
