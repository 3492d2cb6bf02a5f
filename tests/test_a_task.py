"""The example of a stranger's task, as a stranger installs and uses it."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from installing import call, imports_of_causalbench

EXAMPLE = Path(__file__).parents[1] / "examples" / "a_task"
MODULE = EXAMPLE / "causalbench_hover.py"


def test_it_imports_from_causalbench_what_its_facade_offers() -> None:
    assert imports_of_causalbench(MODULE) == {"causalbench.task"}


SOLVES = """
import gymnasium
from gymnasium.utils.env_checker import check_env
env = gymnasium.make("causalbench:hover/Hover-v0", backend="BACKEND").unwrapped
check_env(env, skip_render_check=True)
for seed in range(5):
    _, info = env.reset(seed=seed, options={"stage": 1})
    for _ in range(env.task.horizon):
        *_, terminated, truncated, info = env.step(env.worlds.expert())
        if terminated:
            break
    assert info["is_success"], seed
print("solved")
"""


def test_gymnasium_makes_it_by_its_id_and_the_expert_solves_it(site: Path, tmp_path: Path, backend: str) -> None:
    (tmp_path / "solve.py").write_text(SOLVES.replace("BACKEND", backend))
    done = call(tmp_path, site, "solve")
    assert done.stdout.strip().endswith("solved"), done.stderr


@pytest.mark.long
def test_a_suite_discovers_its_causes_and_ranks_methods_on_it(site: Path, tmp_path: Path) -> None:
    suite = str(EXAMPLE / "suite.yaml")
    done = call(tmp_path, site, "causalbench", "run", suite, "--tier", "smoke", "--out", "run", "--quiet")
    assert done.returncode == 0, done.stderr
    edges = pd.read_csv(tmp_path / "run" / "discovery.csv")
    strong = edges[edges["oracle_grade"] == "strong"]
    found = {(row.stage, row.term, row.action) for row in edges[edges["selected"] == 1].itertuples()}
    # Base x drives world y and base y world -x; near its reach limit armx moves the hand down, too.
    assert found >= {(1, "r_x", "army"), (1, "r_y", "armx"), (2, "r_z", "armz")}
    assert (strong["selected"] == 1).all()
    board = pd.read_csv(tmp_path / "run" / "leaderboard.csv")
    assert set(board["method"]) == {"cmSAC", "mSAC"}
