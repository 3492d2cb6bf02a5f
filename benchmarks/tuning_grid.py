"""The one tuning grid that every method gets: python benchmarks/tuning_grid.py --out runs/tuning (an hour or two).

Learning rate by entropy start (SAC: temperature; PPO: log std of the policy), on the kinematic backend alone, on seeds
that no reported result uses. The methods are those without discovery; cm rows take what cmm rows got, being the same
learner. Each point is a `causalbench run` of its own folder, so that the same command continues. The table is the mean
area under the success curve over seeds.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pandas as pd
import yaml

GRID = {
    "SAC": ("ent_coef_init", (0.01, 0.05, 0.2), (3e-4, 1e-3, 3e-3)),
    "PPO": ("log_std_init", (-1.0, -0.5, 0.0), (1e-4, 3e-4, 1e-3)),
}
METHODS = {"SAC": ["SAC", "mSAC", "cSAC", "cmmSAC"], "PPO": ["PPO", "mPPO", "cmmPPO"]}
SEEDS = (20, 21)
STEPS = 20_000


def run(family: str, settings: dict[str, float], folder: Path) -> pd.DataFrame:
    """The results of one point, which is run as far as it is missing."""
    suite = {
        "schema": 1,
        "name": "tuning",
        "task": "pure_manipulation",
        "backends": ["kinematic"],
        "methods": METHODS[family],
        "tiers": {"quick": {"seeds": max(SEEDS) + 1, "env_steps": STEPS}},
        "evaluation": {"every": 2_000, "episodes": 10, "final_episodes": 20},
        "learner": {family: settings},
    }
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "tuning.yaml"
    path.write_text(yaml.safe_dump(suite, sort_keys=False))
    command = [sys.executable, "-m", "causalbench", "run", str(path), "--out", str(folder / "run"), "--quiet"]
    for seed in SEEDS:
        command += ["--only", f"seed={seed}"]
    done = subprocess.run(command, stdout=subprocess.DEVNULL)
    if done.returncode > 1:  # 1: a cell failed, which its row says
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}")
    return pd.read_csv(folder / "run" / "results.csv").assign(**settings)


def main() -> None:
    """Run the grid and write `grid.csv`: one row a method, learning rate and entropy start."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    out = parser.parse_args().out
    tables = []
    for family, (name, starts, rates) in GRID.items():
        points = [{"learning_rate": rate, name: start} for rate in rates for start in starts]
        for point in points:
            slug = "_".join(f"{value:g}" for value in point.values())
            table = run(family, point, out / f"{family}_{slug}").rename(columns={name: "entropy_start"})
            tables.append(table)
            keys = ["method", "learning_rate", "entropy_start"]
            grid = pd.concat(tables).groupby(keys)[["success_auc", "success_deterministic", "success_sampled"]].mean()
            grid.round(4).reset_index().to_csv(out / "grid.csv", index=False, lineterminator="\n")
    print(grid.round(3).to_string())


if __name__ == "__main__":
    main()
