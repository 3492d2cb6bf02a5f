"""What the discovery benchmarks share, and the page that is made of what they measured."""

import importlib
import subprocess
import sys
from pathlib import Path

import discoveries
import numpy as np
import pandas as pd
import pytest

from causalbench.core.discovery.collection import Recipe
from causalbench.core.discovery.pipeline import discover
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.run.judged import judge_graph
from causalbench.store.samples import SampleFolder

ROOT = Path(__file__).parents[1]
TINY = DiscoverySettings(training_count=64, max_epochs=1)


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
        np.testing.assert_array_equal(again.kl, stage.kl)
        np.testing.assert_array_equal(again.matrix, stage.matrix)


def test_a_measurement_is_made_once(tmp_path):
    calls = []
    for _ in range(2):
        discoveries.measured(tmp_path / "a.csv", lambda: calls.append(1) or [{"x": 1}])
    assert calls == [1]
    pd.testing.assert_frame_equal(
        discoveries.put_together(tmp_path, "all", tmp_path / "docs"), pd.DataFrame({"x": [1]})
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
