"""The example of a task over a Gymnasium environment, as a stranger installs and uses it."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest
from gym_tasks import CAR_FILE
from installing import call, imports_of_causalbench

EXAMPLE = CAR_FILE.parent


def test_it_imports_from_causalbench_what_its_facade_offers() -> None:
    assert imports_of_causalbench(CAR_FILE) == {"causalbench.task"}


SOLVES = """
import sys
import causalbench_mountain_car
assert "gymnasium.envs.classic_control.continuous_mountain_car" not in sys.modules, "a plugin imports no simulator"
import gymnasium
env = gymnasium.make("causalbench:mountain_car/MountainCar-v0").unwrapped
for seed in range(3):
    _, info = env.reset(seed=seed, options={"stage": 1 + seed % 2})
    for _ in range(env.task.horizon):
        *_, terminated, truncated, info = env.step(env.worlds.expert())
        if terminated:
            break
    assert info["is_success"], seed
print("solved")
"""


def test_gymnasium_makes_it_by_its_id_and_the_expert_solves_it(site: Path, tmp_path: Path) -> None:
    (tmp_path / "solve.py").write_text(SOLVES)
    done = call(tmp_path, site, "solve")
    assert done.stdout.strip().endswith("solved"), done.stderr


@pytest.mark.long
def test_a_suite_discovers_its_causes_ranks_methods_on_it_and_skips_what_cannot_be(site: Path, tmp_path: Path) -> None:
    """On a backend of scenes, too, which has no environment of it; films are made of what was trained."""
    text = (EXAMPLE / "suite.yaml").read_text().replace("[gymnasium]", "[gymnasium, kinematic]")
    (tmp_path / "suite.yaml").write_text(text)
    done = call(tmp_path, site, "causalbench", "run", "suite.yaml", "--tier", "smoke", "--out", "run", "--quiet")
    assert done.returncode == 1, done.stderr  # for the cells that were skipped
    skipped = re.findall(r"(\w+)-s0-\w+: skipped\. (.*)", done.stdout)
    reason = "backend 'kinematic' cannot run task 'mountain_car', which has environments for gymnasium alone"
    assert skipped == [(name, reason) for name in ("kinematic", "cmSAC", "mSAC")]

    edges = pd.read_csv(tmp_path / "run" / "discovery.csv")
    assert set(edges.loc[edges["oracle_grade"] == "strong", "action"]) == {"drive"}
    assert ((edges["selected"] == 1) == (edges["action"] == "drive")).all()
    assert len(edges) == 8  # 2 actions on 2 terms in each of 2 stages
    rows = pd.read_csv(tmp_path / "run" / "results.csv")
    assert set(rows["method"]) == {"cmSAC", "mSAC"}
    assert rows["held_rate"].isna().all()  # nothing follows a success

    played = call(tmp_path, site, "causalbench", "play", "run", "--only", "method=mSAC", "--episodes", "1")
    assert played.returncode == 0, played.stderr
    (film,) = (tmp_path / "run" / "videos").glob("*.mp4")
    assert film.stat().st_size > 5_000
