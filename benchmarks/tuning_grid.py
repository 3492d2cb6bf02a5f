"""The one tuning grid that every method gets: python benchmarks/tuning_grid.py (an hour on two cores).

Learning rate by entropy start (SAC: temperature; PPO: log std of the policy), on the kinematic backend alone, on seeds
that no reported result uses. The methods are those without discovery; cm rows take what cmm rows got, being the same
learner. Each point is a `causalbench run` of its own folder, so that the same command continues.

A method leaves its preset only for a point that is better on every seed: more area under the success curve or, where
that is equal, under the curve of the stage in which an episode ends. Of several such points it takes the one with the
best mean. Writes docs/data/tuning_grid.csv, a row per method, point and seed; docs/learning_results.md shows it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pandas as pd
import yaml
from pages import DOCS

from causalbench.core.learners.registry import LEARNERS
from causalbench.report.stats import area_under

GRID = {
    "SAC": ("ent_coef_init", (0.01, 0.05, 0.2), (3e-4, 1e-3)),
    "PPO": ("log_std_init", (-1.0, -0.5, 0.0), (1e-4, 3e-4, 1e-3)),
}
METHODS = {"SAC": ["SAC", "mSAC", "cSAC", "cmmSAC"], "PPO": ["PPO", "mPPO", "cmmPPO"]}
SEEDS = (20, 21)
STEPS = 10_000
POINT = ["learning_rate", "entropy_start"]
SCORE = ["success_auc", "stage_auc"]


def run(family: str, settings: dict[str, float], folder: Path) -> pd.DataFrame:
    """A row per method and seed of one point, which is run as far as it is missing."""
    suite = {
        "schema": 1,
        "name": "tuning",
        "task": "pure_manipulation",
        "backends": ["kinematic"],
        "methods": METHODS[family],
        "tiers": {"quick": {"seeds": max(SEEDS) + 1, "env_steps": STEPS}},
        "evaluation": {"every": 2_500, "episodes": 5, "final_episodes": 20},
        "learner": settings,
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
    return scored(pd.read_csv(folder / "run" / "results.csv"), pd.read_csv(folder / "run" / "curves.csv"))


def scored(results: pd.DataFrame, curves: pd.DataFrame) -> pd.DataFrame:
    """`results` with `stage_auc`: area under the share of the task's stages that an episode leaves behind."""
    area = {
        key: area_under(list(c["env_steps"]), list((c["mean_final_stage"] - 1) / 4), STEPS)
        for key, c in curves.groupby(["method", "seed"])
    }
    stage_auc = [area[key] for key in zip(results["method"], results["seed"], strict=True)]
    return results.assign(stage_auc=stage_auc)[["method", "seed", *SCORE, "success_deterministic", "success_sampled"]]


def chosen(grid: pd.DataFrame) -> pd.DataFrame:
    """A row per method: the point it takes by the rule above, with its mean scores and those of the preset."""
    rows = []
    for method, here in grid.groupby("method", sort=False):
        family = next(family for family, methods in METHODS.items() if method in methods)
        preset = LEARNERS[family].presets["quick"]
        start = (preset.learning_rate, getattr(preset, GRID[family][0]))
        points = {
            point: [tuple(score) for score in at.sort_values("seed")[SCORE].to_numpy()]
            for point, at in here.groupby(POINT)
        }
        better = [
            point for point, scores in points.items() if all(a > b for a, b in zip(scores, points[start], strict=True))
        ]
        mean = here.groupby(POINT)[SCORE].mean()
        best = max(better, key=lambda point: tuple(mean.loc[point]), default=start)
        row = {"method": method} | dict(zip(POINT, best, strict=True)) | {"preset": "yes" if best == start else "no"}
        rows.append(row | dict(mean.loc[best]) | {f"preset_{name}": mean.loc[start][name] for name in SCORE})
    return pd.DataFrame(rows)


def main() -> None:
    """Run the grid, write its table and print which point each method takes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, default=Path("runs/tuning"), help="where each point's run is kept")
    parser.add_argument("--docs", type=Path, default=DOCS, help="where the table goes")
    args = parser.parse_args()
    tables = []
    for family, (name, starts, rates) in GRID.items():
        for rate in rates:
            for start in starts:
                table = run(family, {"learning_rate": rate, name: start}, args.work / f"{family}_{rate:g}_{start:g}")
                tables.append(table.assign(learning_rate=rate, entropy_start=start))
    grid = pd.concat(tables)[["method", *POINT, "seed", *SCORE, "success_deterministic", "success_sampled"]]
    grid = grid.sort_values("method", kind="stable").round(4)
    grid.to_csv(args.docs / "tuning_grid.csv", index=False, lineterminator="\n")
    print(chosen(grid).round(3).to_string(index=False))


if __name__ == "__main__":
    main()
