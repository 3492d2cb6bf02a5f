"""The point of the grid that each method takes: `python studies/tuning/analysis.py runs/tuning_sac-quick [FOLDER ...]`.

A method leaves its preset only for a point that is better on every seed: more area under the success curve or, where
that is equal, under the curve of the stage in which an episode ends. Of several such points it takes the one with the
best mean.
"""

import sys
from pathlib import Path

import pandas as pd

from causalbench.report.stats import area_under

STEPS, N_STAGES = 60_000, 4
PRESET = {"SAC": {"learning_rate": 1e-3, "ent_coef_init": 0.05}, "PPO": {"learning_rate": 3e-4, "log_std_init": -0.5}}
SCORE = ["success_auc", "stage_auc"]


def scored(run: Path) -> pd.DataFrame:
    """Rows of results.csv with `stage_auc`, the area under the share of the task's stages that an episode leaves."""
    curves = pd.read_csv(run / "curves.csv").groupby(["method", "grid_point", "seed"])
    areas = {
        key: area_under(list(c["env_steps"]), list((c["mean_final_stage"] - 1) / N_STAGES), STEPS) for key, c in curves
    }
    results = pd.read_csv(run / "results.csv")
    keys = zip(results["method"], results["grid_point"], results["seed"], strict=True)
    return results.assign(stage_auc=[areas[key] for key in keys])


def preset_of(method: str, grid_points: list[str]) -> str:
    """The grid point that is the preset of the method's learner."""
    values = PRESET[method[-3:]].items()
    (found,) = (v for v in grid_points if all(f"{key}={value:g}" in v for key, value in values))
    return found


def chosen(rows: pd.DataFrame) -> pd.DataFrame:
    """A row per method: the grid point that it takes by the rule above, with its mean scores."""
    out = []
    for method, own in rows.groupby("method"):
        scores = {v: list(map(tuple, at.sort_values("seed")[SCORE].to_numpy())) for v, at in own.groupby("grid_point")}
        preset = preset_of(method, list(scores))
        better = [v for v, s in scores.items() if all(a > b for a, b in zip(s, scores[preset], strict=True))]
        mean = own.groupby("grid_point")[SCORE].mean()
        best = max(better, key=lambda point: tuple(mean.loc[point]), default=preset)
        out.append({"method": method, "grid_point": best, "preset": best == preset} | dict(mean.loc[best]))
    return pd.DataFrame(out)


if __name__ == "__main__":
    print(chosen(pd.concat([scored(Path(folder)) for folder in sys.argv[1:]])).round(3).to_string(index=False))
