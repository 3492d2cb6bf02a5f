"""The example of a stranger's learner, as a stranger installs and uses it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from installing import call, imports_of_causalbench
from sharing import made_once

EXAMPLE = Path(__file__).parents[1] / "examples" / "a_learner"
MODULES = sorted((EXAMPLE / "causalbench_cross_entropy").glob("*.py"))
RUN = ("causalbench", "run", str(EXAMPLE / "suite.yaml"), "--tier", "smoke", "--out", "run", "--quiet")
BESIDE = ("cmmCEM", "mCEM", "mSAC")
ONLY = [word for method in BESIDE for word in ("--only", f"method={method}")]


@pytest.fixture(scope="module")
def finished(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the smoke run of its suite."""

    def make(folder: Path) -> None:
        done = call(folder, site, *RUN, *ONLY)
        assert done.returncode == 0, done.stderr

    return made_once(tmp_path_factory, "cross_entropy_run", make) / "run"


def test_it_is_short_and_imports_from_causalbench_what_the_facades_offer() -> None:
    assert sum(len(path.read_text().splitlines()) for path in MODULES) < 150
    assert imports_of_causalbench(*MODULES) == {"causalbench.learner", "causalbench.method"}


def test_listing_learners_imports_no_torch(site: Path, tmp_path: Path) -> None:
    code = (
        "import sys\nfrom causalbench.plugins.manager import load_plugins\n"
        "print(load_plugins().learner('CEM').about, 'torch' in sys.modules)"
    )
    (tmp_path / "listing.py").write_text(code)
    assert call(tmp_path, site, "listing").stdout == "cross-entropy search of a linear policy per stage False\n"


def test_it_is_ranked_beside_the_built_in_methods(finished: Path) -> None:
    board = pd.read_csv(finished / "leaderboard.csv")
    assert set(board["method"]) == set(BESIDE)
    assert (board["failed_cells"] == 0).all()
    results = pd.read_csv(finished / "results.csv").set_index("method")
    assert (results["env_steps"] == 600).all()
    assert results.loc["cmmCEM", "discovery_env_steps"] == 0


def test_its_generations_count_as_updates_and_its_settings_are_in_the_cell(finished: Path) -> None:
    (cell,) = finished.glob("cells/*-cmmCEM-*")
    settings = json.loads((cell / "cell.json").read_text())["learner"]
    assert settings == {"population": 2, "elite_share": 0.25, "start_std": 0.5, "least_std": 0.02, "n_envs": 1}
    counts = json.loads((cell / "counts.json").read_text())
    # Every episode of 600 steps visits stage 1, and 2 trials make a generation.
    assert counts["updates"]["1"] == counts["episodes"] // 2 > 0


def test_a_search_of_its_own_finds_what_gradients_would(site: Path, tmp_path: Path) -> None:
    """The algorithm by itself: the best of many draws moves the mean towards the optimum of a quadratic."""
    code = (
        "import numpy as np\n"
        "from causalbench_cross_entropy import SearchSettings\n"
        "from causalbench_cross_entropy.search import StageSearch\n"
        "goal = np.array([[1.0, -2.0], [0.5, 0.0]])\n"
        "search = StageSearch(np.arange(2), 1, SearchSettings(start_std=1.0), np.random.default_rng(0))\n"
        "for _ in range(24 * 40):\n"
        "    drawn = search.draw()\n"
        "    search.tell(-np.square(drawn - goal).sum(), drawn)\n"
        "print(np.abs(search.mean - goal).max() < 0.05, search.generations)\n"
    )
    (tmp_path / "quadratic.py").write_text(code)
    assert call(tmp_path, site, "quadratic").stdout == "True 40\n"


def test_a_setting_that_it_does_not_have_is_refused_with_the_nearest(
    site: Path, use_plugins: Callable, cli: Callable, tmp_path: Path
) -> None:
    use_plugins(site)
    text = (EXAMPLE / "suite.yaml").read_text().replace("CEM: {population: 24}", "CEM: {populaton: 24}")
    (tmp_path / "suite.yaml").write_text(text)
    done = cli("plan", "suite.yaml")
    assert done.returncode == 2
    assert "learner.CEM.populaton: unknown key. Did you mean 'population'?" in done.stderr


def test_its_policies_play_and_load(finished: Path, site: Path, tmp_path: Path) -> None:
    (cell,) = finished.glob("cells/*-mCEM-*")
    code = (
        "import causalbench\n"
        "env = causalbench.make_env()\n"
        f"action, _ = causalbench.load_policy({str(cell / 'policy')!r}).predict(env.reset(seed=0)[0])\n"
        "print(env.action_space.contains(action))"
    )
    (tmp_path / "loads.py").write_text(code)
    assert call(tmp_path, site, "loads").stdout == "True\n"
